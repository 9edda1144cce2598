"""Simulated flights under faults in which an operator gives scripts at random, legal and illegal ones.

    legal      the difference between what runs and another configuration that is legal: a module is moved or stopped
    stale      such a difference, given when something else may run already
    broken     a script with a line missing, doubled or changed, or cut short
    release    the end of a script that is held

The oracles of every flight must hold. Besides, a script that the manager refuses must change nothing at once: the
manager neither prepares an epoch nor holds a target that it did not hold before.

    python -m lab.scripts_in_flight --runs 500 --seed 9000
    python -m lab.scripts_in_flight elevator_and_chute --runs 20 --standby --json
"""

import argparse
import json
import sys
from collections import Counter
from dataclasses import dataclass, field, replace
from random import Random
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_dg.verify import verify
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import ReleaseTarget
from heronry_manager.shell.control_protocol import FlyScript
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.console.errors import exit_code
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import spec_path
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.flight.campaign import fly_all
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import MS, Simulation

SPECS: Final = ("elevator_and_chute", "dg_specs/examples/demux_actuators.dg.yaml", "big_blue")
_ORDER_EVERY_MS: Final = (20, 900)  # between two orders; the shortest falls into a reconfiguration
_NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class FlightOfScripts:
    """One flight: which faults are drawn, and for how long orders are given."""

    seed: int
    seconds: float
    standby: bool


@dataclass(slots=True)
class Result:
    """What came of a flight: what was ordered, by kind and answer, and every violation."""

    seed: int
    digest: str = ""
    orders: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)


class ScriptingOperator:
    """Gives random scripts to the manager of a simulated flight, until `end_ns`."""

    def __init__(self, simulation: Simulation, random: Random, end_ns: int, result: Result) -> None:
        self._simulation, self._random, self._end_ns, self._result = simulation, random, end_ns, result
        self._stale: str | None = None  # a script made for what ran before

    def begin(self) -> None:
        """Give the first order after a drawn time."""
        wait_ns = self._random.randint(*_ORDER_EVERY_MS) * MS
        if self._simulation.now_ns + wait_ns < self._end_ns:
            self._simulation.at(self._simulation.now_ns + wait_ns, self._order)

    def _order(self) -> None:
        manager = self._simulation.managers.commanding
        if manager is not None:
            kind, order = self._drawn(manager.core)
            before = _commanded(manager.core)
            reply = self._simulation.operator.say(order)
            answer = "nobody" if reply is None else "taken" if reply.done else "refused"
            self._result.orders[f"{kind} {answer}"] += 1
            if answer == "refused" and _commanded(manager.core) != before:
                now_s = self._simulation.now_ns / _NS_PER_S
                self._result.violations.append(f"{now_s:.6f} s  a refused {kind} script has changed what is commanded")
        self.begin()

    def _drawn(self, core: ManagerCore) -> tuple[str, FlyScript | ReleaseTarget]:
        plan, random = core.plan, self._random
        if plan is None or random.random() < 0.15:
            return "release", ReleaseTarget()
        spec, running = self._simulation.spec, plan.configuration
        text = difference(module_graph(spec, running), module_graph(spec, another(spec, core.now, running, random)))
        stale, self._stale = self._stale, text
        chance = random.random()
        if chance < 0.2 and stale is not None:
            return "stale", FlyScript(stale)
        if chance < 0.45:
            return "broken", FlyScript(broken(text, random))
        return "legal", FlyScript(text)


def another(spec: Spec, now: Situation, running: Configuration, random: Random) -> Configuration:
    """Return a configuration that is legal now and differs from what runs: one module is elsewhere, or is stopped.

    Where twenty draws find none, it is what runs.
    """
    for _ in range(20):
        if not running.modules:
            break
        name = random.choice(sorted(running.modules))
        pes = [pe for pe in hosts_when_all_is_up(spec, spec.modules[name]) if pe != running.modules[name].pe]
        if pes and random.random() < 0.7:
            changed = {**running.modules, name: replace(running.modules[name], pe=random.choice(pes))}
        else:
            changed = {one: module for one, module in running.modules.items() if one != name}
        found = Configuration(changed)
        if not verify(spec, now, found):
            return found
    return running


def broken(text: str, random: Random) -> str:
    """Return a script with an error, most likely."""
    lines = text.splitlines()
    if not lines:
        return "G.DeleteComponent ( nothing );\n"
    place = random.randrange(len(lines))
    line = lines[place]
    return "\n".join(
        random.choice(
            (
                [*lines[:place], *lines[place + 1 :]],
                [*lines[: place + 1], *lines[place:]],
                [*lines[:place], line[: len(line) // 2]],
                [*lines[:place], line.replace("(", "( no_such_", 1), *lines[place + 1 :]],
            )
        )
    )


def fly(spec: Spec, flight: FlightOfScripts) -> Result:
    """Fly once."""
    faults = drawn_faults(spec, flight.seed, flight.seconds, of_two=flight.standby)
    scenario = Scenario(flight.seed, flight.seconds, faults, drawn=True, standby=flight.standby)
    result = Result(flight.seed)

    def begun(simulation: Simulation, start_ns: int) -> None:
        end_ns = start_ns + round(flight.seconds * _NS_PER_S)
        ScriptingOperator(simulation, Random(f"scripts of {flight.seed}"), end_ns, result).begin()

    outcome = play(spec, scenario, begun)
    result.digest = outcome.digest
    result.violations += map(str, outcome.violations)
    return result


def _commanded(core: ManagerCore) -> tuple[object, ...]:
    """What a refused script must leave as it is: the last epoch, and whether a script is held."""
    status = core.status()
    return status["epoch"], status["script"]["state"] == "held"


def main(argv: list[str] | None = None) -> int:
    """Fly; gives the exit code, 1 where an oracle was violated."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specs", metavar="SPEC", nargs="*", help=f"default: {', '.join(SPECS)}")
    parser.add_argument("--runs", type=int, default=20, help="flights of each spec")
    parser.add_argument("--seed", type=int, default=1, help="of the first flight")
    parser.add_argument("--seconds", type=float, default=10.0, help="with faults and orders")
    parser.add_argument("--standby", action="store_true", help="two managers")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="one line of JSON")
    arguments = parser.parse_args(argv)
    orders: Counter[str] = Counter()
    failed: list[str] = []
    with Progress() as progress:
        for name in arguments.specs or SPECS:
            seeds = range(arguments.seed, arguments.seed + arguments.runs)
            flights = [FlightOfScripts(seed, arguments.seconds, arguments.standby) for seed in seeds]
            progress.begin(name, len(flights))
            for result in fly_all(spec_path(name), flights, arguments.jobs, fly):
                progress.step()
                orders += result.orders
                failed += [f"{name} seed {result.seed}: {violation}" for violation in result.violations]
    if arguments.json:
        print(json.dumps({"orders": dict(sorted(orders.items())), "violations": failed}))
    else:
        print("\n".join([*failed, *(f"{count:7} {kind}" for kind, count in sorted(orders.items()))]))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "scripts"))
