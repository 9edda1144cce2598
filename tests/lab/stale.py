"""Silence is seen: flights without a silence tell none, and in flights with one each is told in time and nobody else.

    python -m lab.stale --flights 300 --jobs 2

For each spec three kinds of flights: undisturbed; with one module that falls silent at a random moment, in all its
outputs or in one; and with other faults, drawn as `heronry sim` draws them. The oracle `stale` judges every report in
each flight, and in those with one silence also whether each was reported in time. Exit code 1: something was told where
nothing was silent, was told wrongly or too late, or a module with `silent: fails` led to no new epoch.
"""

import argparse
import statistics
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Literal

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events import FaultReported, InputSilent, OutputSilent, Reconfigured
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.campaign import fly_all
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import Simulation

Kind = Literal["undisturbed", "one silence", "other faults"]
KINDS: tuple[Kind, ...] = ("undisturbed", "one silence", "other faults")
SPARE = Path(__file__).parents[1] / "scenarios/spare_barometer.dg.yaml"
_SECONDS = 4.0
_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight to be flown: its seed and its kind."""

    seed: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Flown:
    """What became of a flight.

    told: silences that the manager has told. first_ms: time from the silence to the first of them; None: there is none.
    failed, reconfigured: modules that failed by their silence, and whether a new epoch followed.
    """

    flight: Flight
    told: int
    first_ms: float | None
    failed: int
    reconfigured: bool
    wrong: tuple[str, ...]


def faults_of(spec: Spec, flight: Flight) -> tuple[Fault, ...]:
    """Return the faults of a flight, from its seed."""
    random = Random(f"stale {flight.seed}")
    if flight.kind == "undisturbed":
        return ()
    if flight.kind == "other faults":
        return drawn_faults(spec, flight.seed, _SECONDS)
    module = random.choice([one for one in spec.modules.values() if any(mode.gives for mode in one.modes.values())])
    lasts_ms = random.choice((0, random.randint(200, 2500)))
    return (
        Fault(random.randint(0, 1500), "silent", f"module:{module.name}", lasts_ms, level=random.choice((0, 0, 1))),
    )


def fly(spec: Spec, flight: Flight) -> Flown:
    """Fly one flight."""
    simulations: list[Simulation] = []
    begun_ns: list[int] = []

    def begun(simulation: Simulation, start_ns: int) -> None:
        simulations.append(simulation)
        begun_ns.append(start_ns)

    faults = faults_of(spec, flight)
    outcome = play(spec, Scenario(flight.seed, _SECONDS, faults, drawn=True), begun)
    (simulation,) = simulations
    told = [one.t_ns for one in (*simulation.events_of(InputSilent), *simulation.events_of(OutputSilent))]
    failed = [one for one in simulation.events_of(FaultReported) if one.code == "STALE"]
    epochs = simulation.events_of(Reconfigured)
    first_ms = None
    if told and flight.kind == "one silence":
        first_ms = (min(told) - begun_ns[0]) / _MS - faults[0].at_ms
    return Flown(
        flight,
        len(told),
        first_ms,
        len(failed),
        not failed or any(one.t_ns > failed[0].t_ns for one in epochs),
        tuple(str(one) for one in outcome.violations),
    )


def report(name: str, flown: list[Flown]) -> Iterator[str]:
    """Yield the lines about the flights of one spec."""
    for kind in KINDS:
        these = [one for one in flown if one.flight.kind == kind]
        if not these:
            continue
        first = sorted(one.first_ms for one in these if one.first_ms is not None)
        times = (
            f"; first told after {statistics.median(first):.0f} ms (median), {first[-1]:.0f} ms at most"
            if first
            else ""
        )
        told, failed = sum(one.told for one in these), sum(one.failed for one in these)
        stayed, wrong = sum(not one.reconfigured for one in these), sum(len(one.wrong) for one in these)
        yield f"{name}, {kind}: {len(these)} flights, {sum(one.told > 0 for one in these)} of them with silences told"
        yield f"  {told} silences{times}; {failed} modules failed by them, {stayed} without a new epoch"
        yield f"  {wrong} violations"


def is_wrong(one: Flown) -> bool:
    """Tell whether a flight went wrong."""
    return bool(one.wrong) or not one.reconfigured or (one.flight.kind == "undisturbed" and one.told > 0)


def main() -> int:
    """Fly all, and print what was found; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20, help="of each kind and spec")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--spec", type=Path, action="append", help="default: elevator_and_chute and one with `fails`")
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.flights)
    good = True
    for file in arguments.spec or (shipped_spec_path("elevator_and_chute"), SPARE):
        flights = [Flight(seed, kind) for kind in KINDS for seed in seeds]
        flown = list(fly_all(file, flights, arguments.jobs, fly))
        print("\n".join(report(load(file).name, flown)), flush=True)
        for one in filter(is_wrong, flown):
            good = False
            print(f"  {one.flight}: {'; '.join(one.wrong) or 'told, or without a new epoch'}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
