"""Starts the manager of `heronry manager`, and runs it until it ends.

This file opens the bus and the operator's socket, starts the planner, reads the journal (with the last term),
and runs the core with its driver.
"""

import argparse
import os
import signal
import sys
import time
from contextlib import ExitStack, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

from heronry_dg.model import Spec
from heronry_dg.wire_limits import require_wire_limits
from heronry_manager import events
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.tables import Compiler, ContingencyNumbers, PeTables, on_board
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planning_policy import PlanningPolicy
from heronry_manager.shell.control_place import STANDBY, default_socket
from heronry_manager.shell.control_socket import ControlSocket
from heronry_manager.shell.driver import FILTERS, ManagerDriver
from heronry_manager.shell.journal import Journal
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_manager.shell.spec_reloads import SpecReloads
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.console.bus_flags import what_it_models
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.reports.event_printer import print_event, surviving
from heronry_tools.reports.screen import screen
from heronry_tools.runtime.bundle_files import read_bundles
from heronry_tools.runtime.manager_cores import PLANNER_NICENESS, PRE_PLANNER_NICENESS, ManagerCores
from heronry_tools.runtime.wake_ups import with_heartbeat
from heronry_wire.bus_arguments import channel_configs, flagged_bus
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER
from heronry_wire.key_file import read_key
from heronry_wire.replicated_link import AnyLink, open_link
from heronry_wire.service_manager import ServiceManager


def mastership(arguments: argparse.Namespace) -> int:
    """Run the manager until it is stopped, or its core ends by itself.

    Returns 0 if the manager was stopped, and 1 if its core has ended by itself.
    Raises WireLimitError if the spec exceeds what the protocol can encode.
    """
    spec = with_heartbeat(load_spec_file(arguments.spec), arguments.slower_heartbeat_ns)
    require_wire_limits(spec)
    key = None if arguments.key is None else read_key(arguments.key)
    has_solver = _has_solver()
    bus = spec.buses[spec.manager.bus]
    config = {"bitrate": bus.bitrate, **flagged_bus(arguments), "can_filters": FILTERS}
    channels = channel_configs(config, bus.channels, f"bus {bus.name} of {spec.name}")

    def open_bus() -> AnyLink:
        return open_link(channels, bus.heartbeat_ns, bus.misses)

    made = (
        None
        if arguments.contingencies is Ahead.SINGLE_FAULTS and not has_solver
        else contingencies_of(spec, arguments.contingencies, lambda: open_bus().close())
    )
    table = None if made is None else ContingencyTable(spec, made)
    compiler, held = Compiler(spec), [] if made is None else on_board(spec, made)
    numbers = None if made is None else ContingencyNumbers(spec, made, held)
    bundles = () if arguments.bundles is None else read_bundles(arguments.bundles)
    tell = surviving(print_event if arguments.json else screen(spec))
    link = open_bus()
    service = ServiceManager()
    file = spec_path(arguments.spec)
    try:
        with ExitStack() as stack, ExitStack() as planners_of_first:
            second = "-advisor" if arguments.advise else "" if _node(arguments) == FIRST_MANAGER else STANDBY
            name = f"{spec.name}{second}"
            control = stack.enter_context(ControlSocket(arguments.socket or default_socket(name)))
            cores = ManagerCores(arguments, _node(arguments), key, bundles, has_solver, stack)
            reloads = SpecReloads(
                spec,
                file,
                lambda path: with_heartbeat(load_spec_file(str(path)), arguments.slower_heartbeat_ns),
                cores.prepare,
                Path(stack.enter_context(TemporaryDirectory(prefix="heronry-"))),
                close=planners_of_first.close,
            )
            # Planners read the copy: the file may be edited while the aircraft flies.
            planner = cores.planner(planners_of_first, spec, reloads.flies, PLANNER_NICENESS)
            if planner is not None and made is None:  # else the first plan was made ahead
                planner.wait_until_ready()

            def start_pre_planner(first_copy: Path = reloads.flies) -> PlannerClient:
                return planners_of_first.enter_context(PlannerClient(spec, first_copy, niceness=PRE_PLANNER_NICENESS))

            told = _bus_event(spec.manager.bus, arguments)
            tell(told)
            journal = None if arguments.advise else stack.enter_context(_journal(spec, arguments))
            if journal is not None:
                reloads.resume(journal.file.with_suffix(".other"))
            memory, now_ns = NOTHING if journal is None else journal.memory, time.monotonic_ns()

            tables = PeTables(compiler, held).contents()
            core = cores.core(spec, compiler, memory, now_ns, on_board=numbers, tables=tables)
            policy = PlanningPolicy(spec, Greedy(spec), has_planner=has_solver, contingencies=table)
            planners = PlannerProcesses(policy, planner, start_pre_planner)

            parts = (core, link, planners, control)
            driver = ManagerDriver(
                *parts,
                journal=journal,
                service=service,
                spec=spec,
                emit=tell,
                place=events.Place(told.name, told.interface, told.channel),
                file=str(file.resolve()),
                reloads=reloads,
                in_order=not arguments.json,
            )
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: driver.stop())
            reason = driver.run(until_eof=arguments.until_eof)
            service.stopping()
    finally:
        link.close()
        service.close()
    if reason is not None:
        print(f"heronry: {reason}", file=sys.stderr)
    return 0 if reason is None else 1


def _journal(spec: Spec, arguments: argparse.Namespace) -> Journal:
    folder = arguments.state_dir or default_state_dir(spec.name)
    journal = Journal(folder, _node(arguments), spec, accept_changed_spec=arguments.changed_spec)
    if journal.warning is not None:
        _say(journal.warning)
    return journal


def _node(arguments: argparse.Namespace) -> int:
    """Return the node-ID of this manager: that of the command line, or the usual one of its kind."""
    if arguments.node is not None:
        return int(arguments.node)
    return LAST_MANAGER if arguments.standby else FIRST_MANAGER


def _has_solver() -> bool:
    """Tell whether the solver is installed; if not, warn the user here, since the planner's process has no terminal."""
    try:
        import_module("ortools")
    except ModuleNotFoundError:
        how = 'pip install "heronry[manager]"'
        _say(f"ortools is not installed, so only the greedy planner is used; add it with: {how}")
        return False
    return True


def _say(sentence: str) -> None:
    with suppress(OSError):  # a full disk must not stop the manager
        print(f"heronry: {sentence}", file=sys.stderr)


def default_state_dir(spec_name: str) -> Path:
    """Return the folder for files that must outlive a restart: below XDG_STATE_HOME, one per spec."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "heronry" / spec_name


def _bus_event(name: str, arguments: argparse.Namespace) -> events.Bus:
    interface = getattr(arguments, "interface", None) or "can.conf's interface"
    channel = str(getattr(arguments, "channel", None) or "")
    models = f"{name}: {what_it_models(interface, channel)}"
    return events.Bus(time.monotonic_ns(), name, interface, channel, models)
