"""Runs the demo of `heronry demo`, and cleans up after it."""

import argparse
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

from heronry_agent.shell.device_choice import DeviceChoiceError, read_devices
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.shell.ordered_telling import Tell
from heronry_tools.analysis.made_ahead import can_plan_ahead, contingencies_of, kept_contingencies
from heronry_tools.console.contingencies_argument import Ahead, Source
from heronry_tools.console.errors import UserError
from heronry_tools.console.flight_limits import DEMO_S, LONGEST_DEMO_S
from heronry_tools.console.output import expect_ending
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.reports.event_printer import print_event
from heronry_tools.reports.screen import screen
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import NODE_PRIORITY, Fleet, run_folder
from heronry_tools.runtime.demo.manager_name import manager_name
from heronry_tools.runtime.demo.page import Page
from heronry_tools.runtime.demo.planning_ahead import PlanningAhead
from heronry_tools.runtime.demo.process_orders import ProcessOrders
from heronry_tools.runtime.demo.run import Show
from heronry_tools.runtime.demo.script import DemoAction, PhaseAction, read_phases, read_script
from heronry_tools.runtime.wake_ups import kept_heartbeat_ns, latest_wake_up_ns, with_heartbeat
from heronry_wire import interruption
from heronry_wire.bus_arguments import named_buses
from heronry_wire.key_file import read_key
from heronry_wire.spelling import meant

_AFTER_LAST_ACTION_S = 5.0
_REHEARSAL_S = 0.25  # with a wake-up of each process every 10 ms
_MORE_PROCESSES = 2  # a hub and a manager, beside the agents
_OF_A_PAGE = 2  # the process that serves the page, and a browser that draws it

_Why = Literal["rehearsal", "rehearsal with a page", "given"]
_REHEARSED: _Why = "rehearsal"
_WITH_PAGE: _Why = "rehearsal with a page"


def play(arguments: argparse.Namespace) -> int:
    """Run one demo; returns its exit code."""
    spec = load_spec_file(arguments.spec)
    actions: list[DemoAction | PhaseAction] = [*read_script(spec, arguments.kill, arguments.restore)]
    actions = sorted([*actions, *read_phases(spec, arguments.phase)], key=lambda action: action.at_s)
    last_s = actions[-1].at_s + _AFTER_LAST_ACTION_S if actions else DEMO_S
    usual = LONGEST_DEMO_S if arguments.web else max(DEMO_S, last_s)
    seconds = arguments.seconds if arguments.seconds is not None else usual
    if actions and actions[-1].at_s > seconds:
        raise UserError(
            f"--for {seconds:g}: the demo would end before the action at {actions[-1].at_s:g} s; make --for longer"
        )
    if arguments.no_kill and (arguments.kill or arguments.restore):
        raise UserError("--no-kill flies without a kill; leave --kill and --restore out")
    if arguments.key is not None:
        read_key(arguments.key)
    if arguments.record is not None:
        expect_ending(arguments.record, {"log": (".log",)})
    if arguments.devices is not None:
        _require_devices(arguments.devices, spec)
    with ExitStack() as stack:
        record = stack.enter_context(arguments.record.open("w", encoding="ascii")) if arguments.record else None
        folder = run_folder()
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        choices = choose(spec, folder, named_buses(arguments.bus, "the spec", spec.buses), _first(arguments))
        late_ns, heartbeat_ns, why = _heartbeat(spec, arguments)
        flown = with_heartbeat(spec, heartbeat_ns)
        made, behind = _plans_ahead(spec, arguments.spec, arguments.contingencies)
        file = spec_path(arguments.spec)
        stack.enter_context(interruption.in_order())  # fifty processes end, which takes some hundred ms
        called = stack.enter_context(manager_name(spec.name))
        fleet = stack.enter_context(
            Fleet(
                *(flown, file, folder, made, arguments.key),
                aloft_s=arguments.aloft_s,
                called=called,
                heartbeat_ns=heartbeat_ns,
                devices=arguments.devices,
            )
        )
        orders = stack.enter_context(ProcessOrders(fleet.control_socket()))
        page = None
        if arguments.web:
            page = stack.enter_context(Page(file, fleet.control_socket(), folder / "web.log"))
        fleet.start_buses(choices)
        tell = print_event if arguments.json else screen(flown)
        own_ns = spec.buses[spec.manager.bus].heartbeat_ns
        period_ns = flown.buses[spec.manager.bus].heartbeat_ns
        tell(events.Heartbeat(time.monotonic_ns(), late_ns=late_ns, period_ns=period_ns, of_spec_ns=own_ns, why=why))
        tell(events.Logs(time.monotonic_ns(), folder=str(folder), kept=False))
        flags = f"--of {called}" if called is not None else f"--socket {fleet.control_socket()}"
        tell(events.Orders(time.monotonic_ns(), flags=flags))
        if behind is not None:
            stack.callback(behind.close)
        show = Show(flown, fleet, choices, tell, behind, orders=orders, page=page)
        chosen = actions if actions or arguments.no_kill else None
        return _run(show, fleet, tell, lambda: show.run(chosen, seconds, record))


def _heartbeat(spec: Spec, arguments: argparse.Namespace) -> tuple[int, int, _Why]:
    """Return how late processes run here (0: not rehearsed), the shortest heartbeat to fly with, and why that one.

    Raises UserError where the user gives one that is shorter than the spec's.
    """
    if arguments.heartbeat_ns is None:
        beside, why = (_OF_A_PAGE, _WITH_PAGE) if arguments.web else (0, _REHEARSED)
        late_ns = latest_wake_up_ns(len(spec.pes) + _MORE_PROCESSES, _REHEARSAL_S, NODE_PRIORITY, beside)
        return late_ns, kept_heartbeat_ns(late_ns), why
    own_ns = spec.buses[spec.manager.bus].heartbeat_ns
    if arguments.heartbeat_ns < own_ns:
        raise UserError(
            f"--heartbeat {arguments.heartbeat_ns / 1e6:g}: the spec has {own_ns / 1e6:g} ms, which a demo can only "
            "lengthen; write a longer one, or change heartbeat_ms of the bus"
        )
    return 0, arguments.heartbeat_ns, "given"


def _require_devices(file: Path, spec: Spec) -> None:
    """Read a file of devices as the agents will; raises HeronryError."""
    for device in read_devices(file):
        if device not in spec.devices:
            raise DeviceChoiceError(f"{file}: the spec has no device '{device:.70}'; {meant(device, spec.devices)}")


def _plans_ahead(spec: Spec, text: str, source: Source) -> tuple[Contingencies | None, PlanningAhead | None]:
    """Return the contingencies with which the demo flies, and the process, if any, that makes those for the next."""
    if source is not Ahead.SINGLE_FAULTS:
        return contingencies_of(spec, source), None
    made = kept_contingencies(spec)
    # none were made: fly without, and make them meanwhile if a solver is installed
    return made, PlanningAhead(spec, spec_path(text)) if made is None and can_plan_ahead() else None


def _run(show: Show, fleet: Fleet, tell: Tell, run: Callable[[], int]) -> int:
    """Run the demo; keep its logs if a process, a module or the demo has failed."""
    try:
        code = run()
    except UserError as error:
        raise UserError(f"{error}; the logs are kept in {fleet.keep_logs()}") from None
    if code or show.saw_failure:
        tell(events.Logs(time.monotonic_ns(), folder=str(fleet.keep_logs()), kept=True))
    return code


def _first(arguments: argparse.Namespace) -> tuple[str, str, int | None] | None:
    """Return interface, channel and bit rate of the manager's bus from python-can's flags; None if no flag is given.

    A bit rate of None: the flags name none. Raises UserError for an interface without a channel.
    """
    interface, channel = getattr(arguments, "interface", None), getattr(arguments, "channel", None)
    if interface is None and channel is None:
        return None
    if channel is None:
        raise UserError(f"-i {interface} needs a channel; add -c, for example -c vcan0")
    return interface or "socketcan", channel, getattr(arguments, "bitrate", None)
