"""Flies a script with real processes: every manager and PE is a process, on software buses or on a given bus.

Time is real, and the computer also runs other programs. So three things differ from a simulated flight:

    - an output may be late by 100 ms before it counts as silent
    - an expectation during the start of a process gets 3 s more
    - no golden trace is compared

`--patience N` makes the 100 ms N times as long, and also the time within which an expectation must come true.

Partitions load their code when their first module starts. So the script begins when all functions that the newest
plan serves have been heard, but no later than `LOADING_S` seconds after the first configuration began to run.

Only some deeds can be done to processes (`process_deeds`), and a radio can be disturbed (`bad_radios`). Other faults of
wires, clocks and controllers can be injected only in the simulator.

When the flight ends, for whatever reason, all processes that it has started are ended (`Fleet`).
"""

import argparse
import select
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from heronry_manager import events
from heronry_manager.contingency.contingencies import Contingencies
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.buses import choose, hub_paths
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_tools.sim.faults.fault import MANAGERS
from heronry_tools.sim.scenario.bad_radios import KINDS, BadRadios
from heronry_tools.sim.scenario.evaluation import Evaluation
from heronry_tools.sim.scenario.flown import Flown
from heronry_tools.sim.scenario.observations import Observations
from heronry_tools.sim.scenario.process_deeds import Step, can_be_done, steps
from heronry_tools.sim.scenario.script import EXAMPLE, ORDERS, Deed, Expectation, Script
from heronry_tools.sim.scenario.trace import deed_line, event_line
from heronry_tools.sim.world.planning import plan_ahead
from heronry_wire.identifiers import FIRST_MANAGER, MANAGER_NODES
from heronry_wire.key_file import make_key

SLACK_NS = 100_000_000
STARTING_NS = 3_000_000_000
_TO_PE: dict[str, Callable[[Fleet, str], object]] = {
    "kill": Fleet.kill_pe,
    "restore": Fleet.start_pe,
    "stop": Fleet.stop,
    "go_on": Fleet.go_on,
}
LOADING_S = 10.0
_LONGEST_START_S = 60.0
_LONGEST_WAIT_S = 0.1


def check(script: Script) -> None:
    """Raise UserError for a script without expectations, or with deeds that cannot be done to processes."""
    if not script.expectations:
        raise UserError(
            f"{script.file}: no 'expect' in this file, so nothing would be checked; add for example '{EXAMPLE}', "
            "or leave -i and -c out: in the simulator the oracles check the flight"
        )
    for deed in script.deeds:
        if not (can_be_done(deed) or _is_of_a_radio(script, deed)):
            raise UserError(
                f"{script.file}:{deed.line}: '{deed.text}' can be done only in the simulator; leave -i and -c out"
            )


def _is_of_a_radio(script: Script, deed: Deed) -> bool:
    """Tell whether a hub can cause the fault of a deed (`bad_radios`): it is not on the managers' bus."""
    return deed.fault is not None and deed.fault.kind in KINDS and deed.fault.name != script.spec.manager.bus


def fly(script: Script, arguments: argparse.Namespace) -> Flown:
    """Fly a script with real processes and return the result.

    arguments: python-can's options for the managers' bus; and `patience`, a factor for the allowed times (None: 1).
    """
    spec = script.spec
    with ExitStack() as stack:
        folder = run_folder()
        fleet = stack.enter_context(
            Fleet(spec, script.spec_file, folder, _made_ahead(script), _made_key(script, folder))
        )
        choices = choose(spec, folder, {}, _named(arguments), prefer_vcan=False)
        hubs = hub_paths(choices)
        of_radios = [deed for deed in script.deeds if _is_of_a_radio(script, deed)]
        for deed in of_radios:
            if deed.fault is not None and deed.fault.name not in hubs:
                where = "on software buses that the flight starts; write -i softbus, and leave -c out"
                raise UserError(f"{script.file}:{deed.line}: '{deed.text}' can be done only {where}")
        fleet.start_buses(choices)
        ear = stack.enter_context(Ear(choices[spec.manager.bus], spec.buses[spec.manager.bus]))
        radios = stack.enter_context(BadRadios(of_radios, hubs))
        return _Show(script, fleet, ear, radios, arguments.patience or 1.0).run(choices[spec.manager.bus].describe())


def _made_ahead(script: Script) -> Contingencies | None:
    """Make the contingencies of a script; None if it has none."""
    return None if script.contingencies is None else plan_ahead(script.spec, script.contingencies)


def _made_key(script: Script, folder: Path) -> Path | None:
    """Make the key file of a script in `folder`; None if the script has no key."""
    if not script.has_key:
        return None
    file = folder / "fleet.key"
    make_key(file)
    return file


def _named(arguments: argparse.Namespace) -> tuple[str, str, int | None] | None:
    """Return interface, channel and bit rate that python-can's options give; None if the bus is a software bus."""
    interface, channel = getattr(arguments, "interface", None), getattr(arguments, "channel", None)
    if channel is not None:
        return interface or "socketcan", channel, getattr(arguments, "bitrate", None)
    if interface != "softbus":
        raise UserError(f"-i {interface} needs a channel; add -c, for example -c vcan0")
    return None


class _Show:
    """One flight of a script with real processes, in real time."""

    def __init__(self, script: Script, fleet: Fleet, ear: Ear, radios: BadRadios, patience: float) -> None:
        self._script, self._fleet, self._ear, self._radios = script, fleet, ear, radios
        self._patience = patience
        self._heard = Observations(script.spec)
        self._deeds = list(script.deeds)  # those not in the trace yet
        self._steps = steps(script.deeds)
        self._events: dict[int, EventStream] = {}  # by node-ID of the manager
        self._starting_ns = {step.deed.at_ns for step in self._steps if step.what == "restore"}
        self._injected: dict[int, int] = {}  # by line of a deed: the node-ID of its manager
        self._served: list[str] = []  # functions that the last plan serves
        self._runs_ns: int | None = None  # since when the first configuration runs
        self._start_ns: int | None = None
        self._trace: list[str] = []

    def run(self, where: str) -> Flown:
        """Fly to the end of the script; `where` names the bus in the result."""
        for node in MANAGER_NODES if self._script.has_standby else (FIRST_MANAGER,):
            self._start_manager(node)
        for pe in self._script.spec.pes:
            if f"pe:{pe}" not in self._script.without:
                self._fleet.start_pe(pe)
        begun_s = time.monotonic()
        while self._elapsed_ns() < self._script.end_ns:
            readers: list[Any] = [*self._events.values(), *self._ear.readers]
            select.select(readers, [], [], self._wait_s())
            for event in [event for stream in self._events.values() for event in stream.take()]:
                self._follow(event)
            self._take_frames()
            self._begin()
            self._do_what_is_due()
            problem = self._fleet.ended()
            if problem is None and self._start_ns is None and time.monotonic() - begun_s > _LONGEST_START_S:
                problem = f"no configuration ran within {_LONGEST_START_S:.0f} s"
            if problem is not None:
                raise UserError(f"{self._script.file}: {problem}")
        assert self._start_ns is not None
        evaluation = Evaluation(self._script.spec, self._heard, self._start_ns, int(SLACK_NS * self._patience))
        return Flown(
            self._script,
            where,
            self._script.end_ns / 1e9,
            tuple(evaluation.verdict(self._given_time(one)) for one in self._script.expectations),
            tuple(f"two drivers at once: {a.module} and {b.module}" for a, b in self._heard.witness.rivals),
            tuple(self._trace),
        )

    def _given_time(self, one: Expectation) -> Expectation:
        """Return an expectation with more time: its time limit, if it has one, is multiplied by `patience`.

        If a process is started when the expectation begins, the limit also gets the time for the start,
        `STARTING_NS`. An expectation without a time limit is returned unchanged.
        """
        if not one.within_ns:
            return one
        starting_ns = STARTING_NS if one.from_ns in self._starting_ns else 0
        return replace(one, within_ns=int(one.within_ns * self._patience) + starting_ns)

    def _elapsed_ns(self) -> int:
        return -1 if self._start_ns is None else time.monotonic_ns() - self._start_ns

    def _wait_s(self) -> float:
        if self._start_ns is None:
            return _LONGEST_WAIT_S
        elapsed_ns = self._elapsed_ns()
        told_ns, done_ns = (deed.at_ns for deed in self._deeds), (step.at_ns for step in self._steps)
        next_ns = min([self._script.end_ns, *told_ns, *done_ns])
        radio_ns = self._radios.next_ns(elapsed_ns)
        next_ns = next_ns if radio_ns is None else min(next_ns, radio_ns)
        return max(0.0, min(_LONGEST_WAIT_S, (next_ns - elapsed_ns) / 1e9))

    def _follow(self, event: events.Event) -> None:
        line = event_line(event)
        if line is not None:
            self._trace.append(line)
        if isinstance(event, events.PlanReady):
            self._served = event.plan.served()
        elif isinstance(event, events.Reconfigured) and self._runs_ns is None:
            self._runs_ns = event.t_ns

    def _begin(self) -> None:
        """Begin the script once every function that the newest plan serves was heard on the bus.

        If a function is not heard, the script begins LOADING_S seconds after the first configuration began to run.
        Before that configuration runs, and after the script has begun, a call has no effect.
        """
        if self._start_ns is not None or self._runs_ns is None:
            return
        now_ns, functions = time.monotonic_ns(), self._script.spec.functions
        heard = {output.module for output in self._heard.outputs}
        loaded = all(heard.intersection(functions[name].outputs) for name in self._served)
        if loaded or now_ns - self._runs_ns > LOADING_S * 1e9:
            self._start_ns = now_ns

    def _take_frames(self) -> None:
        for time_ns, frame in self._ear.hear():
            self._heard.see(time_ns, frame)

    def _do_what_is_due(self) -> None:
        while self._deeds and self._deeds[0].at_ns <= self._elapsed_ns():
            deed = self._deeds.pop(0)
            self._trace.append(deed_line(deed.at_ns / 1e9, deed.text))
        while self._steps and self._steps[0].at_ns <= self._elapsed_ns():
            self._do(self._steps.pop(0))
        if self._start_ns is not None:
            self._radios.follow(self._elapsed_ns())

    def _do(self, step: Step) -> None:
        place = f"{self._script.file}:{step.deed.line}: '{step.deed.text}'"
        if step.what in ORDERS:
            self._fleet.order(ORDERS[step.what](step.target), place)
            return
        try:
            if step.target in MANAGERS:
                self._do_to_manager(step)
            else:
                _TO_PE[step.what](self._fleet, step.target.removeprefix("pe:"))
        except UserError as error:
            raise UserError(f"{place}: {error}") from None

    def _do_to_manager(self, step: Step) -> None:
        """Execute a step of a deed (an action of the script) on the manager that the deed names.

        The second step of a deed goes to the same manager as the first.
        """
        node = self._injected.get(step.deed.line) if step.is_last else MANAGERS[step.target]
        if node is None:
            node = FIRST_MANAGER if step.what == "restore" else self._fleet.active_manager()
        self._injected[step.deed.line] = node
        match step.what:
            case "kill":
                del self._events[node]
                self._fleet.kill_manager(node)
            case "restore":
                self._start_manager(node)
            case "stop":
                self._fleet.stop(node)
            case _:
                self._fleet.go_on(node)

    def _start_manager(self, node: int) -> None:
        self._events[node] = EventStream(self._fleet.start_manager(node, standby=self._script.has_standby))
