"""How fast an aircraft of eight PEs reacts on a half-loaded bus to the loss of one.

The aircraft is made for this: eight PEs on one bus of 1 Mbit/s, data and management together half of what it carries;
eight modules that talk and eight that listen from other PEs, each with a second PE to move to; and a DEMUX with
branches on two PEs. Rates differ by a few per cent, so that data meet at random, as clocks have them do after hours of
flight; in the first seconds after a GO the data of all PEs come at once. In each flight one PE dies, at a moment that
the seed draws. Every single fault is pre-planned, and the plans are on board: to decide is a look-up, and the manager
commands the plan by its number.

    decide                CPU time of that look-up: from the request to a plan (`core.planning_policy`)
    decision to active    from the plan to the last state frame of a PE that runs it: in one step, or after BREAK, or
                          GO; where a silent PE held the DEMUX, to the last one about all that does not wait for it
    fault to active       from the death of a PE to the same; a row of its own where a silent PE held the DEMUX: to the
                          last state frame about the DEMUX, for which T_lease passes first

Virtual times are exact, and contain messages alone: cores and modules compute in no time. To fly the same aircraft with
real processes on a software bus: `--write FILE`, `heronry contingencies FILE -o PLANS --faults 1`, then
`python -m lab.benches.reconfiguration --spec FILE --contingencies PLANS`.

Exit code 1 where a p99 is above its limit.
"""

import sys
import time
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from heronry_agent.module import Inputs, Module, Value
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.vocabulary import PlanReady, RequestPlan
from heronry_manager.planning_policy import Answer, PlanningPolicy, Source
from heronry_tools.console.number_arguments import flights, whole_number
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning import prepared
from heronry_wire.identifiers import Use, classify
from heronry_wire.state_frames import PeState, StatePage0, decode_state
from lab.benches.harness import Benchmark, Report, counted, option

PES = 8
TALKERS = 8
VARIABLES_EACH = 4
HERE = "lab.benches.reaction"

DECIDE_MS = 0.1  # limits of each p99, in milliseconds
ONE_STEP_MS = {20: 3.0}  # by heartbeat period, like the limits below
SEVERAL_STEPS_MS = {20: 5.0}
REACTION_MS = {20: 80.0, 5: 30.0}

FORESEEN = 1  # faults at once

_START_NS = 1_000 * MS
_STEADY_NS = 500 * MS
_AFTER_NS = 500 * MS
_NS_PER_S = 1_000_000_000
_HAVE_GONE = (PeState.PARTIAL, PeState.ACTIVE)
_LOOK_UPS = 50  # of each request


class Talks(Module):
    """A module that gives each of its variables a number, at every step."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it reads no input
        """Do nothing: the outputs keep their numbers."""
        return {f"{self.ctx.module}_{i}": 1.0 for i in range(VARIABLES_EACH)}


class Listens(Module):
    """A module without outputs."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it is enough that it runs
        """Do nothing."""
        return {}


class Commands(Module):
    """A module that gives the variable of the DEMUX."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Compute nothing."""
        return {"demand": 1.0}


class Drives(Module):
    """A module that commands its actuator from its input."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command the actuator to the input."""
        if "demand" in inputs:
            self.ctx.write(inputs["demand"].value)
        return {}


def aircraft(heartbeat_ms: int, reserve: float) -> str:
    """Return the text of the spec."""
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
        rate = f"rate_hz: {100 + TALKERS - 1 - 2 * i}"
        lines.append(f'  talker_{i}: {{image: "{HERE}:Talks", gives: {{{gives}}}, {_homes(i)}, {size}, {rate}}}')
        lines.append(
            f'  listener_{i}: {{image: "{HERE}:Listens", needs: {{and: [{needs}]}}, {_homes(i + 2)}, '
            f"{size}, rate_hz: {50 + i - TALKERS // 2}}}"
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
    """Return the PEs on which a module may run: one and the next."""
    return f"runs_on: [pe_{first % PES}, pe_{(first + 1) % PES}]"


@dataclass(slots=True)
class Times:
    """The measured times, in milliseconds."""

    decide: list[float] = field(default_factory=list)
    one_step: list[float] = field(default_factory=list)
    several_steps: list[float] = field(default_factory=list)
    reaction: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)  # a silent PE held the DEMUX
    loads: list[float] = field(default_factory=list)  # of the bus, before each death


def measure_decisions(spec: Spec, times: Times) -> None:
    """Look up the loss of each PE `_LOOK_UPS` times; no other fault came before."""
    table = prepared(spec, FORESEEN).made
    policy = PlanningPolicy(spec, None, has_planner=True, contingencies=table)
    running = placement(_foreseen(policy, RequestPlan(0, Situation(), None)).configuration)
    for number in range(_LOOK_UPS):
        for pe in spec.pes:
            request = RequestPlan(number, Situation(frozenset({f"pe:{pe}"})), dict(running))
            begun_ns = time.process_time_ns()
            _foreseen(policy, request)
            times.decide.append((time.process_time_ns() - begun_ns) / 1e6)


def _foreseen(policy: PlanningPolicy, request: RequestPlan) -> Plan:
    """Find a plan among the contingencies; a missing one ends the benchmark."""
    match policy.step(request):
        case [Answer(PlanReady(plan=plan), Source.CONTINGENCIES)]:
            return plan
        case _:
            raise SystemExit(f"{', '.join(sorted(request.now.down)) or 'the start'} was not pre-planned")


def measure_deaths(spec: Spec, seed: int, times: Times) -> None:
    """Let every PE die once, each in a flight of its own."""
    random = Random(f"deaths of {seed}")
    for number, pe in enumerate(spec.pes):
        measure_death(spec, pe, len(spec.pes) * seed + number, random, times)


def measure_death(spec: Spec, pe: str, seed: int, random: Random, times: Times) -> None:
    """Let one PE die in a flight without another fault."""
    simulation = Simulation(spec, seed, contingencies=FORESEEN)
    bus = simulation.wiring.buses["can0"]
    simulation.run_for(_START_NS)
    busy_bits, since_ns = bus.busy_bits, simulation.now_ns
    simulation.run_for(_STEADY_NS + random.randrange(spec.buses["can0"].heartbeat_ns))
    times.loads.append((bus.busy_bits - busy_bits) * _NS_PER_S / bus.bitrate / (simulation.now_ns - since_ns))
    _die(simulation, pe, times)
    violations = simulation.broken()
    if violations:
        raise SystemExit(f"seed {seed}: {violations[0]}")


def _die(simulation: Simulation, pe: str, times: Times) -> None:
    begun_ns, before = simulation.now_ns, simulation.checks.epoch
    assert before is not None
    simulation.events.clear()
    last = simulation.witness.last_output("surface")
    holds = last is not None and last.node == simulation.spec.pes[pe].node_id
    gone: dict[str, int] = {}  # by PE: when its state first named the new epoch
    simulation.wiring.buses["can0"].taps.append(lambda sent: _follow(gone, before, sent))
    simulation.fleet.kill(pe)
    simulation.run_for(_AFTER_NS)
    (done,), (ready,) = simulation.events_of(events.Reconfigured), simulation.events_of(events.PlanReady)
    (opened,) = simulation.events_of(events.EpochPrepared)
    if not opened.contingency:
        raise SystemExit(f"after the loss of {pe} the manager did not switch to a contingency by number")
    (times.held if holds else times.reaction).append((done.t_ns - begun_ns) / MS)
    steps = len(simulation.events_of(events.EpochStep))
    (times.one_step if steps == 1 else times.several_steps).append((max(gone.values()) - ready.t_ns) / MS)


def _follow(gone: dict[str, int], before: int, sent: Sent) -> None:
    """Note the time of each state frame that names another epoch than before."""
    page = decode_state(sent.frame.data) if classify(sent.frame.can_id).use is Use.STATE else None
    if isinstance(page, StatePage0) and page.epoch != before and page.state in _HAVE_GONE:
        gone.setdefault(sent.sender, sent.end_ns)


def tell(spec: Spec, times: Times, report: Report) -> None:
    """Report the times, each with the limit of its p99."""
    heartbeat_ms = spec.buses["can0"].heartbeat_ns // MS
    limit_ms = REACTION_MS.get(heartbeat_ms)
    report.figures(
        "{pes} PEs, 1 Mbit/s, {load:.0%} load, {heartbeat_ms} ms heartbeats, k = 3",
        pes=len(spec.pes),
        load=sum(times.loads) / max(1, len(times.loads)),
        heartbeat_ms=heartbeat_ms,
    )
    report.times("decide (CPU)", times.decide, limit=DECIDE_MS)
    report.times("decision to active, one step", times.one_step, limit=ONE_STEP_MS.get(heartbeat_ms))
    report.times("decision to active, more steps", times.several_steps, limit=SEVERAL_STEPS_MS.get(heartbeat_ms))
    report.times("fault to active", times.reaction, limit=limit_ms)
    held_ms = None if limit_ms is None else limit_ms + 5 * heartbeat_ms
    report.times("fault to active, DEMUX held", times.held, limit=held_ms)


def measure(arguments: Namespace, report: Report) -> None:
    """Measure look-ups and flights."""
    text = aircraft(arguments.heartbeat_ms, arguments.reserve)
    if arguments.write is not None:
        arguments.write.write_text(text)
        return
    spec, times = loads(text, "reaction.dg.yaml"), Times()
    measure_decisions(spec, times)
    seeds = range(arguments.seed, arguments.seed + arguments.flights)
    for seed in counted("flights", len(seeds), seeds):
        measure_deaths(spec, seed, times)
    tell(spec, times, report)


main = Benchmark(
    "reaction",
    __doc__,
    measure,
    option("--flights", 20, "times eight deaths", flights),
    option("--heartbeat-ms", 20, "of the bus", metavar="MS"),
    option("--reserve", 0.1, "for management", float, "SHARE"),
    option("--seed", 0, "of the first flight", whole_number),
    option("--write", None, "write the aircraft's spec, and do not fly", Path, "FILE"),
)
if __name__ == "__main__":
    sys.exit(main())
