"""`heronry bus`: every message of a plan on every bus, with its worst-case response time.

Exit codes: 0 every deadline is met and every budget kept; 1 a deadline is missed or a budget exceeded (TOO MUCH); 2 the
input cannot be used.
"""

import argparse
import json

from heronry_dg.bus_schedule import BusSchedule, bus_schedules
from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.plan import read_configuration
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_tools.console.errors import UserError
from heronry_tools.console.plan_argument import errors_name, evaluated_in, read_text, situation_of
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.reports.buses import document, print_buses


def run(arguments: argparse.Namespace) -> int:
    """Show the buses; returns the exit code."""
    with Working(f"the traffic of {arguments.spec}"):
        spec = load_spec(arguments.spec)
        _check_bus(spec, arguments.bus)
        now, configuration = _planned(spec, arguments)
        found = bus_schedules(spec, now, configuration, every_echo=arguments.every_echo)
    schedules = [s for s in found if arguments.bus in (None, s.bus.name)]
    if arguments.json:
        print(json.dumps(document(spec, now, schedules), indent=2))
    else:
        print_buses(spec, now, schedules)
    return 0 if all(map(_is_kept, schedules)) else 1


def _is_kept(schedule: BusSchedule) -> bool:
    """Tell whether data and management fit their budgets on a bus, and all messages meet their deadlines.

    A bus that is down has no budget for management; deadlines count only on a wired bus that is up.
    """
    late = schedule.bus.kind == "wired" and any(m.slack_ns is None or m.slack_ns < 0 for m in schedule.messages)
    if not schedule.is_up:
        return schedule.data_fit
    return schedule.data_fit and schedule.management_fits and not late


def _check_bus(spec: Spec, bus: str | None) -> None:
    if bus is not None and bus not in spec.buses:
        raise UserError(f"{spec.name} has no bus '{bus}'; its buses are {', '.join(spec.buses)}")


def _planned(spec: Spec, arguments: argparse.Namespace) -> tuple[Situation, Configuration]:
    if arguments.plan is not None:
        return _given(spec, arguments)
    from heronry_manager.planner.exact import plan  # noqa: PLC0415 - the solver, which --plan does not need

    now = situation_of(spec, arguments)
    return now, plan(spec, now).configuration


def _given(spec: Spec, arguments: argparse.Namespace) -> tuple[Situation, Configuration]:
    text = read_text(arguments.plan)
    with errors_name(arguments.plan):
        now, configuration = evaluated_in(spec, text, arguments), read_configuration(text)
    for violation in verify(spec, now, configuration):
        if violation.rule.startswith(("1.", "2.")):
            raise UserError(
                f"{arguments.plan}: {violation}; while the plan breaks this rule, "
                "the frames that it puts on the bus cannot be worked out: correct the plan"
            )
    return now, configuration
