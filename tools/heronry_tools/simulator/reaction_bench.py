"""How fast an aircraft of eight PEs reacts on a half-loaded bus: `python -m heronry_tools.simulator.reaction_bench`.

The aircraft is made for this: eight PEs on one bus of 1 Mbit/s, data and management together half of what it carries;
eight modules that talk and eight that listen from other PEs, each with a second PE to move to; and a DEMUX with
branches on two PEs. In each flight every PE dies once, at a moment that the seed draws, and comes back.
All of that is foreseen, so deciding is a look-up.

    decide                CPU time of that look-up: from the question to a plan (`planner.foresight`)
    decision to active    from the plan to the last PE's word that it runs: in one step, or after BREAK, or GO
    fault to active       from the death of a PE to the same; apart where a silent PE held the DEMUX: then T_lease
                          passes first

Virtual times are exact, and those of messages alone: cores and modules compute in no time. Real processes on a software
bus fly the same aircraft (`--write FILE`, then `python -m heronry_tools.demo.bench --spec FILE`).

Exit code 1 where a p99 is above its limit.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from heronry_agent.module import Inputs, Module, Value
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.situation import Situation
from heronry_manager.planner.client import Failed, Planned
from heronry_manager.planner.foresight import Foresight
from heronry_manager.vocabulary import PlanReady, RequestPlan
from heronry_tools.progress import Progress
from heronry_tools.simulator.planning import best_plan
from heronry_tools.simulator.simulation import MS, Simulation

PES = 8
TALKERS = 8
VARIABLES_EACH = 4
HERE = "heronry_tools.simulator.reaction_bench"

DECIDE_MS = 0.1  # limits of each p99, in milliseconds
ONE_STEP_MS = 3.0
SEVERAL_STEPS_MS = 5.0
REACTION_MS = {20: 80.0, 5: 30.0}  # by heartbeat period

_DECIDE_NS = 100_000  # what the look-up may take
_START_NS = 3_000 * MS
_BETWEEN_NS = 1_200 * MS  # hold-down included
_LOOK_UPS = 50  # of each question


class Talks(Module):
    """Gives each of its variables a number, at every step."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it looks at nothing
        """Compute nothing."""
        return {f"{self.ctx.module}_{i}": 1.0 for i in range(VARIABLES_EACH)}


class Listens(Module):
    """Gives nothing."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it is enough that it runs
        """Compute nothing."""
        return {}


class Commands(Module):
    """Gives what the DEMUX leads on."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Compute nothing."""
        return {"demand": 1.0}


class Drives(Module):
    """Moves its actuator to where it is told."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Move."""
        if "demand" in inputs:
            self.ctx.write(inputs["demand"].value)
        return {}


def aircraft(heartbeat_ms: int, reserve: float) -> str:
    """The text of its spec."""
    lines = ["dg: 1", f"name: reaction_{heartbeat_ms}_ms"]
    lines += [f"buses: {{can0: {{bitrate: 1000000, heartbeat_ms: {heartbeat_ms}, reserve: {reserve}}}}}", "pes:"]
    lines += [f"  pe_{i}: {{node_id: {92 + i}, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}" for i in range(PES)]
    lines += ["devices:", *(f"  servo_{i}: {{kind: actuator, pe: pe_{i}}}" for i in (0, 1)), "variables:"]
    lines += [f"  talker_{i}_{j}: {{type: FLOAT}}" for i in range(TALKERS) for j in range(VARIABLES_EACH)]
    lines += ["  demand: {type: FLOAT}", "gates:", "  servos: {demux: demand}", "modules:"]
    size = "cpu: 0.15, ram: 1KiB"
    for i in range(TALKERS):
        gives = ", ".join(f"talker_{i}_{j}: 1" for j in range(VARIABLES_EACH))
        needs = ", ".join(f"talker_{i}_{j}" for j in range(VARIABLES_EACH))
        lines.append(f'  talker_{i}: {{image: "{HERE}:Talks", gives: {{{gives}}}, {_homes(i)}, {size}, rate_hz: 100}}')
        lines.append(
            f'  listener_{i}: {{image: "{HERE}:Listens", needs: {{and: [{needs}]}}, {_homes(i + 2)}, '
            f"{size}, rate_hz: 50}}"
        )
    lines.append(f'  commander: {{image: "{HERE}:Commands", gives: {{demand: 1}}, {_homes(2)}, {size}, rate_hz: 50}}')
    lines += [
        f'  driver_{i}: {{image: "{HERE}:Drives", needs: servos, device: servo_{i}, {size}, rate_hz: 50}}'
        for i in (0, 1)
    ]
    lines += ["functions:", "  surface: {output: servos, criticality: A}"]
    lines += [f"  heard_{i}: {{output: listener_{i}, criticality: B}}" for i in range(TALKERS)]
    return "\n".join([*lines, ""])


def _homes(first: int) -> str:
    """Where a module may run: on a PE, or on the next one."""
    return f"runs_on: [pe_{first % PES}, pe_{(first + 1) % PES}]"


@dataclass(slots=True)
class Times:
    """What was measured, in milliseconds."""

    decide: list[float] = field(default_factory=list)
    one_step: list[float] = field(default_factory=list)
    several_steps: list[float] = field(default_factory=list)
    reaction: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)  # a silent PE held the DEMUX
    load: float = 0.0  # of the bus


class _InThisProcess:
    """A planner that answers when it is polled; the questions are few, and answered once."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._answers: list[Planned | Failed] = []

    def request(self, number: int, now: Situation, running: Placement | None) -> None:
        """Answer."""
        self._answers.append(Planned(number, best_plan(self._spec, now, running)))

    def poll(self) -> list[Planned | Failed]:
        """Give what has been answered."""
        answers, self._answers = self._answers, []
        return answers

    def fileno(self) -> int:
        """Nobody waits for it."""
        return -1


def measure_decisions(spec: Spec, times: Times) -> None:
    """Look up each loss of a PE while all runs well, again and again."""
    foresight = Foresight(spec, _InThisProcess(spec), lambda: _InThisProcess(spec))
    running = placement(best_plan(spec, Situation(), None).configuration)
    foresight.settled(frozenset(), None, running)
    while foresight.is_thinking:
        foresight.poll()
    for number in range(_LOOK_UPS):
        for pe in spec.pes:
            asked = RequestPlan(number, frozenset({f"pe:{pe}"}), None, dict(running))
            begun_ns = time.process_time_ns()
            found = foresight.request(asked)
            times.decide.append((time.process_time_ns() - begun_ns) / 1e6)
            if not isinstance(found, PlanReady):
                raise SystemExit(f"the loss of {pe} was not foreseen")


def measure_flight(spec: Spec, seed: int, times: Times) -> None:
    """Let every PE die once, and come back."""
    random = Random(f"deaths of {seed}")
    simulation = Simulation(spec, seed, decide_ns=_DECIDE_NS)
    simulation.run_for(_START_NS)
    for pe in random.sample(list(spec.pes), len(spec.pes)):
        simulation.run_for(_BETWEEN_NS + random.randrange(spec.buses["can0"].heartbeat_ns))
        _die(simulation, pe, times)
        simulation.run_for(_BETWEEN_NS)
        simulation.restore(pe)
        simulation.run_for(_BETWEEN_NS)
    violations = simulation.settle()
    if violations:
        raise SystemExit(f"seed {seed}: {violations[0]}")
    times.load = simulation.buses["can0"].busy_bits * 1e9 / spec.buses["can0"].bitrate / simulation.now_ns


def _die(simulation: Simulation, pe: str, times: Times) -> None:
    begun_ns, known = simulation.now_ns, len(simulation.events)
    last = simulation.witness.last_output("surface")
    holds = last is not None and last.node == simulation.spec.pes[pe].node_id
    simulation.kill(pe)
    simulation.run_for(_BETWEEN_NS)
    seen = simulation.events[known:]
    done = next((event for event in seen if event["event"] == "reconfigured"), None)
    if done is None:
        return  # nothing ran there
    ready = next(event for event in seen if event["event"] == "plan_ready")
    steps = sum(event["event"] == "epoch_step" for event in seen)
    reaction_ms = (done["t_ns"] - begun_ns) / MS
    (times.held if holds else times.reaction).append(reaction_ms)
    if not holds:
        (times.one_step if steps == 1 else times.several_steps).append((done["t_ns"] - ready["t_ns"]) / MS)


def report(spec: Spec, times: Times) -> bool:
    """Print the figures; tells whether every p99 is within its limit."""
    heartbeat_ms = spec.buses["can0"].heartbeat_ns // MS
    limit_ms = REACTION_MS.get(heartbeat_ms)
    held_ms = None if limit_ms is None else limit_ms + 5 * heartbeat_ms
    rows = [
        ("decide (CPU)", times.decide, DECIDE_MS),
        ("decision to active, one step", times.one_step, ONE_STEP_MS),
        ("decision to active, more steps", times.several_steps, SEVERAL_STEPS_MS),
        ("fault to active", times.reaction, limit_ms),
        ("fault to active, DEMUX held", times.held, held_ms),
    ]
    print(f"{len(spec.pes)} PEs, 1 Mbit/s, {times.load:.0%} load, {heartbeat_ms} ms heartbeats, k = 3")
    print(f"{'ms':32}{'count':>7}{'median':>9}{'p99':>9}{'longest':>9}{'limit':>9}")
    good = True
    for name, values, limit in rows:
        if values:
            ordered = sorted(values)
            p99 = ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]
            good = good and (limit is None or p99 <= limit)
            told = f"{limit:9.1f}" if limit is not None else ""
            print(f"{name:32}{len(ordered):7}{ordered[len(ordered) // 2]:9.3f}{p99:9.3f}{ordered[-1]:9.3f}{told}")
    return good


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {HERE}", description="Measure how fast eight PEs on a half-loaded bus react to a loss."
    )
    parser.add_argument("--flights", type=int, default=20, metavar="N", help="of eight deaths each (default: 20)")
    parser.add_argument("--heartbeat-ms", type=int, default=20, metavar="MS", help="default: 20")
    parser.add_argument("--reserve", type=float, default=0.1, metavar="SHARE", help="for management (default: 0.1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the first flight (default: 0)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the aircraft's spec, and fly nothing")
    arguments = parser.parse_args(argv)
    text = aircraft(arguments.heartbeat_ms, arguments.reserve)
    if arguments.write is not None:
        arguments.write.write_text(text)
        return 0
    spec, times = loads(text, "reaction.dg.yaml"), Times()
    measure_decisions(spec, times)
    with Progress() as progress:
        progress.begin("flights", arguments.flights)
        for seed in range(arguments.seed, arguments.seed + arguments.flights):
            measure_flight(spec, seed, times)
            progress.step()
    return 0 if report(spec, times) else 1


if __name__ == "__main__":
    sys.exit(main())
