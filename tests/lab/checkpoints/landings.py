"""Landings of the EAV whose tracking filter moves on final, beside the same landings without a move.

    python -m lab.checkpoints.landings [--seeds 24] [--first 0] [--without]

Each seed is flown twice. In the second flight, the PE that runs the filter is killed at a moment on final that the seed
draws; up to this moment both flights are the same. A landing counts if it is within the limits of `heronry fly`. Exit
code 1: two or more landings fewer than without the kill, in a flight a filter that moved started without its state, or
an oracle found something. With --without the checkpoint is taken away, and only the oracles count.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events import StateRestored
from heronry_tools.console.progress import Progress
from heronry_tools.fly.acceptance import share, share_line
from heronry_tools.fly.campaign import FIRST_BLOW_S, LAST_BLOW_S, line
from heronry_tools.fly.flight import EavFlight
from heronry_tools.fly.mission import Blow, Landing, Mission
from heronry_tools.fly.record import FlightRecord
from lab.checkpoints import without_checkpoints

FILTER = "tracked_position"


@dataclass(frozen=True, slots=True)
class Pair:
    """The flights of one seed.

    age_ms: age of the state from which the filter has started on its new PE, as it is told; None: it had none.
    """

    unmoved: Landing
    moved: Landing
    age_ms: int | None


def fly(spec: Spec, seed: int) -> Pair:
    """Fly both flights of a seed."""
    killed_s = Random(f"{seed} kill").uniform(FIRST_BLOW_S, LAST_BLOW_S)
    unmoved, record = EavFlight(spec, Mission(seed, judged=True)).fly()
    flight = EavFlight(spec, Mission(seed, blows=(Blow(f"pe:{_home(record, killed_s)}", killed_s),), judged=True))
    moved, _ = flight.fly()
    ages = [one.age_ms for one in flight.simulation.events if isinstance(one, StateRestored) and one.module == FILTER]
    return Pair(unmoved, moved, ages[-1] if ages else None)


def _home(record: FlightRecord, at_s: float) -> str:
    """Return the PE that runs the filter at a time of a flight."""
    places = [one for one in record.stretches if one.subject == FILTER and one.start_s <= at_s < one.end_s]
    assert places, f"{FILTER} does not run at {at_s:.1f} s"
    return places[-1].label.partition(" ")[0]


def faults_of(pairs: Sequence[Pair], *, kept: bool) -> list[str]:
    """Return what is wrong with these flights; `kept`: the filter has a checkpoint."""
    wrong = [
        f"seed {pair.moved.mission.seed}: {violation}"
        for pair in pairs
        for violation in (*pair.unmoved.violations, *pair.moved.violations)
    ]
    if not kept:
        return wrong
    wrong += [f"seed {pair.moved.mission.seed}: no state" for pair in pairs if pair.age_ms is None]
    unmoved, moved = (sum(not one.causes for one in landings) for landings in _columns(pairs))
    return [*wrong, f"{moved} landings with a move, {unmoved} without"] if moved < unmoved - 1 else wrong


def _columns(pairs: Sequence[Pair]) -> tuple[list[Landing], list[Landing]]:
    return [pair.unmoved for pair in pairs], [pair.moved for pair in pairs]


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; returns the exit code."""
    parser = argparse.ArgumentParser(description="Kill the PE with the EAV's tracking filter on final.")
    parser.add_argument("--seeds", type=int, default=24, metavar="N", help="number of seeds (default 24)")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="first seed (default 0)")
    parser.add_argument("--without", action="store_true", help="take the checkpoint away")
    arguments = parser.parse_args(argv)
    kept, spec = not arguments.without, load(shipped_spec_path("eav"))
    pairs = []
    with Progress() as progress:
        progress.begin("landings, in pairs", arguments.seeds)
        for seed in range(arguments.first, arguments.first + arguments.seeds):
            pairs.append(fly(spec if kept else without_checkpoints(spec), seed))
            progress.step()
    for pair in pairs:
        state = "no state" if pair.age_ms is None else f"state of {pair.age_ms} ms"
        print(f"{line(pair.moved)}; {state}; unmoved: {', '.join(pair.unmoved.causes) or 'acceptable'}")
    for name, landings in zip(("unmoved", "moved"), _columns(pairs), strict=True):
        print(f"{name}: {share_line(share([one.causes for one in landings]))}")
    failures = faults_of(pairs, kept=kept)
    for failure in failures:
        print(f"FAILURE: {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
