"""Simulated kills of the computer with the controller, at random moments, with a checkpoint and without one.

    python -m lab.checkpoints.kills --kills 500 [--seed 0]

The jump is the difference of the first command after the move and the last one before the kill, as a share of the range
of the command. In every second flight the bus loses and doubles frames. Exit code 1: with a checkpoint a jump was
larger than 1 %, a module that moved started without its state in a flight without losses, or an oracle found something.
"""

import argparse
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

from heronry_dg.traffic import identifiers
from heronry_manager.events import Reconfigured, StateRestored
from heronry_tools.console.progress import Progress
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Faults
from heronry_wire.canaerospace import decode_data
from heronry_wire.frame import Frame, Malformed
from lab.checkpoints import MOST_JUMP, loop
from lab.checkpoints.images import RANGE

_MS = 1_000_000
_LOSSY = Faults(loss=0.02, doubled=0.02)


@dataclass(frozen=True, slots=True)
class Flown:
    """One kill.

    jump: of the command, as a share of its range. gap_ms: time without a command. age_ms: age of the state, as it is
    told; None: the module started without one. wrong: what the oracles found.
    """

    seed: int
    jump: float
    gap_ms: float
    age_ms: int | None
    wrong: tuple[str, ...]


def fly(seed: int, *, kept: bool) -> Flown:
    """Fly the loop, and kill the computer on which the controller runs at a moment that the seed draws."""
    spec, random = loop(kept=kept), Random(f"kill {seed}")
    flight = Simulation(spec, seed, keep_trace=True, faults=_LOSSY if seed % 2 else Faults(), contingencies=1)
    killed_ns = random.randrange(6_000 * _MS, 12_000 * _MS)
    flight.run_until(killed_ns)
    home = next(pe for pe in ("left", "right") if flight.fleet.running[pe].code("controller") is not None)
    flight.fleet.kill(home)
    flight.run_until(killed_ns + 2_000 * _MS)
    number = identifiers(spec)["controller", "command"]
    given = [(sent.end_ns, _value(sent.frame)) for sent in flight.trace if sent.frame.can_id == number]
    before = [one for one in given if one[0] <= killed_ns]
    after = [one for one in given if one[0] > killed_ns]
    starts = [event for event in flight.events if isinstance(event, StateRestored) and event.t_ns > killed_ns]
    restored = [event.age_ms for event in starts if event.module == "controller"]
    assert sum(isinstance(event, Reconfigured) for event in flight.events) > 1
    wrong = tuple(f"{one.rule}: {one.story}" for one in flight.settle())
    return Flown(
        seed,
        abs(after[0][1] - before[-1][1]) / (2 * RANGE),
        (after[0][0] - before[-1][0]) / _MS,
        restored[0] if restored else None,
        wrong,
    )


def _value(frame: Frame) -> float:
    datum = decode_data(frame)
    assert not isinstance(datum, Malformed)
    assert isinstance(datum.value, float)
    return datum.value


def faults_of(flown: Sequence[Flown]) -> list[str]:
    """Return what is wrong with flights with a checkpoint."""
    return [
        *(f"seed {one.seed}: the command jumps by {one.jump:.2%}" for one in flown if one.jump > MOST_JUMP),
        *(f"seed {one.seed}: starts without its state" for one in flown if one.age_ms is None and not one.seed % 2),
        *(f"seed {one.seed}: {what}" for one in flown for what in one.wrong),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; returns the exit code."""
    parser = argparse.ArgumentParser(description="Kill the computer with an integrating controller, and see the jump.")
    parser.add_argument("--kills", type=int, default=500, metavar="N", help="default 500")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="first seed (default 0)")
    arguments = parser.parse_args(argv)
    seeds = range(arguments.seed, arguments.seed + arguments.kills)
    with Progress() as progress:
        progress.begin("kills", 2 * len(seeds))
        found: dict[bool, list[Flown]] = {}
        for kept in (True, False):
            found[kept] = []
            for seed in seeds:
                found[kept].append(fly(seed, kept=kept))
                progress.step()
    for kept, flown in found.items():
        jumps, gaps = [one.jump for one in flown], [one.gap_ms for one in flown]
        ages = [one.age_ms for one in flown if one.age_ms is not None]
        words = f", age of the state {statistics.median(ages):.0f} ms (max {max(ages)})" if ages else ""
        print(
            f"{'with' if kept else 'without':8} {len(flown)} kills: jump {statistics.median(jumps):.2%} of the range "
            f"(max {max(jumps):.2%}), {sum(one <= MOST_JUMP for one in jumps)} of at most {MOST_JUMP:.0%}; "
            f"gap {statistics.median(gaps):.0f} ms (max {max(gaps):.0f}); {len(ages)} restored{words}"
        )
    failures = faults_of(found[True])
    for failure in failures:
        print(f"FAILURE: {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
