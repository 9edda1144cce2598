"""Simulated flights in which a PE lacks the code of a module, and gets it over the bus while other things fail.

In each flight a PE loses the code of one of its modules after a second. Then, at random moments of the transfer, PEs
and managers die and return, wires are cut and mended, and frames are lost, all drawn by the seed. The oracles of every
flight must hold; in the end the PE has the code, and the best plan flies.

    python -m lab.code_flights --runs 500
    python -m lab.code_flights big_blue --runs 20 --seed 9000 --keyed
"""

import argparse
import sys
from collections.abc import Iterator
from random import Random
from typing import Final

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.settings import CodeBundle
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.faults.fault import MANAGER, Fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import KEY, lossy
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.bundle import pack

_LACKS_MS: Final = 500
_TROUBLE_MS: Final = (700, 14_000)
_LASTS_MS: Final = (100, 2_000)
_SECONDS: Final = 17
_LOSS: Final = 0.01
_TROUBLES: Final = ("crash", "reboot", "cut", "pause", "manager_crash", "manager_pause", "manager_cut")
_MOST_TROUBLES: Final = 2  # each may kill the PE, and code on trial has three starts


def bundle_for(spec: Spec, seed: int) -> CodeBundle:
    """Return a bundle for every module of a spec, a few kilobytes long."""
    filler = Random(seed).randbytes(Random(seed).randrange(500, 20_000))
    made = pack("simulated", 1, ("simulated:Code",), {"simulated.py": b"class Code: ...\n", "filler.bin": filler})
    images = frozenset(module.image for module in spec.modules.values())
    return CodeBundle("simulated", 1, images, made.content)


def fly(spec: Spec, seed: int, *, keyed: bool = False) -> tuple[list[Violation], int]:
    """Fly one flight; returns what was violated, and how often a bundle was brought."""
    random = Random(seed)
    simulation = Simulation(
        spec,
        seed,
        faults=lossy(random.choice((0, 0, _LOSS))),
        key=KEY if keyed else None,
        standby=True,
        bundles=(bundle_for(spec, seed),),
    )
    while not simulation.events_of(events.Reconfigured):
        simulation.run_for(MS)
    start_ns = simulation.events_of(events.Reconfigured)[0].t_ns
    injections = Injections(simulation, tuple(_faults(simulation, random)), start_ns)
    simulation.run_until(start_ns + _SECONDS * 1_000 * MS)
    injections.heal()
    violations = simulation.waivers.promised(simulation.settle())
    return list(violations), len(simulation.events_of(events.CodeBrought))


def _faults(simulation: Simulation, random: Random) -> Iterator[Fault]:
    """Draw which code is lost where, and what else happens during the transfer."""
    spec = simulation.spec
    tables = ((pe, table) for pe, table in simulation.fleet.tables.items() if spec.manager.bus in spec.pes[pe].buses)
    pe, module = random.choice([(pe, entry.name) for pe, table in tables for entry in table.modules])
    yield Fault(_LACKS_MS, "missing", f"module:{module}@{pe}")
    for _ in range(random.randint(0, _MOST_TROUBLES)):
        kind = random.choice(_TROUBLES)
        target = MANAGER if kind.startswith("manager") else f"pe:{random.choice([pe, pe, *spec.pes])}"
        yield Fault(random.randint(*_TROUBLE_MS), kind, target, random.randint(*_LASTS_MS))


def main(arguments: list[str] | None = None) -> int:
    """Fly, and print each violation; returns 1 if there was one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", nargs="?", default="elevator_and_chute")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keyed", action="store_true")
    given = parser.parse_args(arguments)
    spec, wrong, brought = load_spec(given.spec), 0, 0
    for seed in range(given.seed, given.seed + given.runs):
        violations, times = fly(spec, seed, keyed=given.keyed)
        brought += times > 0
        for violation in violations:
            print(f"seed {seed}: {violation}")
        wrong += bool(violations)
    print(f"{given.runs} flights of {spec.name}, {wrong} with a violation; code came in {brought}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
