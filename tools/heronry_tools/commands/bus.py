"""`heronry bus`: every message of a plan on every bus, with its worst-case response time.

Exit codes: 0 every deadline is met and every budget kept; 1 a deadline is missed or a budget exceeded (TOO MUCH); 2 the
input cannot be used.
"""

import argparse
import json
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_situation, situation_of
from heronry_tools.console.spec_argument import add_spec_argument

if TYPE_CHECKING:
    from heronry_dg.bus_schedule import BusSchedule
    from heronry_dg.configuration import Configuration
    from heronry_dg.model import Spec
    from heronry_dg.situation import Situation

_EPILOG = """\
Without --plan the command shows the best plan for the situation. With --plan it shows that plan, in the situation that
the plan names, unless options give another one. A plan that overloads a bus can be shown; a plan with a module that
runs nowhere, or with a wire between modules that do not run, cannot.

examples:
  heronry bus big_blue                            all that is on its buses while everything works
  heronry bus big_blue --phase glide --bus can0   one bus, in another phase
  heronry bus big_blue --down pe:nav              ... once the navigation computer is gone
  heronry plan big_blue --json >plan.json
  heronry bus big_blue --plan plan.json --json    the same for a saved plan, for other tools
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry bus`."""
    parser = subparsers.add_parser(
        "bus",
        description="Show what a plan puts on each bus: every message with its longest response time, and the totals.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--plan", metavar="PLAN.json", help="the plan to show (- for standard input)")
    add_situation(parser)
    parser.add_argument("--bus", metavar="NAME", help="show this bus alone")
    parser.add_argument(
        "--every-echo", action="store_true", help="count an echo of every command, as simulated plants ask for it"
    )
    add_output(parser, "write the messages as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show the buses; returns the exit code."""
    from heronry_dg.bus_schedule import bus_schedules  # noqa: PLC0415 - slow to import; `--help` does not need it
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.reports.buses import document, print_buses  # noqa: PLC0415

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


def _is_kept(schedule: "BusSchedule") -> bool:
    """Tell whether data and management fit their budgets on a bus, and all messages meet their deadlines.

    A bus that is down has no budget for management; deadlines count only on a wired bus that is up.
    """
    late = schedule.bus.kind == "wired" and any(m.slack_ns is None or m.slack_ns < 0 for m in schedule.messages)
    if not schedule.is_up:
        return schedule.data <= schedule.data_limit
    return schedule.data <= schedule.data_limit and schedule.management_fits and not late


def _check_bus(spec: "Spec", bus: str | None) -> None:
    if bus is not None and bus not in spec.buses:
        raise UserError(f"{spec.name} has no bus '{bus}'; its buses are {', '.join(spec.buses)}")


def _planned(spec: "Spec", arguments: argparse.Namespace) -> "tuple[Situation, Configuration]":

    if arguments.plan is not None:
        return _given(spec, arguments)
    from heronry_manager.planner.exact import plan  # noqa: PLC0415

    now = situation_of(spec, arguments)
    return now, plan(spec, now).configuration


def _given(spec: "Spec", arguments: argparse.Namespace) -> "tuple[Situation, Configuration]":
    from heronry_dg.plan import read_configuration  # noqa: PLC0415
    from heronry_dg.verify import verify  # noqa: PLC0415
    from heronry_tools.console.plan_argument import errors_name, evaluated_in, read_text  # noqa: PLC0415

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
