"""The command lines of all orders to a local manager: `heronry status`, `phase`, `fail` and their kin."""

import argparse
from typing import Any

from heronry_tools.console.manager_argument import add_manager_argument
from heronry_tools.console.output import add_json, add_output

_STATUS_EPILOG = """\
examples:
  heronry status                       status of the system, from the one manager that runs here
  heronry status --json | jq .phase
  heronry status --exit-code && heronry phase landing      ends with 1 unless all is served, and nothing has failed
  heronry status --of big_blue         where several managers run
"""
_PHASE_EPILOG = """\
examples:
  heronry phase landing                the functions of this phase are wanted from now on: plan for them
"""
_PRIORITY_EPILOG = """\
examples:
  heronry priority imaging 90          the priority of the imaging is 90 in every phase that wants it
  heronry priority imaging 0           ... it is not wanted
  heronry priority imaging default     ... and the spec's again; modules may request others again
"""
_FAIL_EPILOG = """\
examples:
  heronry fail device:gps              the GPS counts as failed, whatever is reported of it
  heronry fail pe:nav                  plan without it, until 'heronry clear pe:nav'
"""
_CLEAR_EPILOG = """\
examples:
  heronry clear device:gps             a fault that was reported, or set with 'heronry fail', is over
  heronry clear pe:nav                 the PE may come back now: its quarantine is over
"""
_RETIRE_EPILOG = """\
examples:
  heronry retire pe:nav                its modules move to other PEs, with the best plan; then it may be switched off
  heronry retire device:gps            the same for a device, a module, a module's place, or a bus

Unlike 'heronry fail' the element still works: what runs there runs on until the best plan without it has come. A PE
that connects others with the manager is retired after them.
"""
_RESTORE_EPILOG = """\
examples:
  heronry restore pe:nav               plans use the PE again, as soon as it is there
"""
_UNLOCK_EPILOG = """\
examples:
  heronry unlock pe:nav                CANopen tools may write to the PE for half a minute; see docs/canopen.md

Only a PE with a key is locked. While it is unlocked, any node on the bus can write to it.
"""
_TRACEBACK_EPILOG = """\
examples:
  heronry status                       shows which modules have failed, each with exception, file and line
  heronry traceback module:autopilot   the traceback of the module's last failure, read from its PE over the bus
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of all commands that give an order to a manager."""
    status = _parser(subparsers, "status", "show the status of the system, as the manager knows it", _STATUS_EPILOG)
    add_output(status, "print the whole status as one JSON object")
    status.add_argument(
        "--exit-code", action="store_true", help="end with 1 if anything is down, has failed or is not served"
    )
    phase = _parser(subparsers, "phase", "enter another mission phase", _PHASE_EPILOG)
    phase.add_argument("what", metavar="NAME", help="a phase of the spec")
    add_json(phase)
    priority = _parser(subparsers, "priority", "change the priority of a function", _PRIORITY_EPILOG)
    priority.add_argument("what", metavar="FUNCTION", help="a function of the spec")
    priority.add_argument(
        "to", metavar="N|default", type=_priority, help="the priority, 0 to 32767; 'default': that of the spec"
    )
    add_json(priority)
    for name, sentence, epilog in (
        ("fail", "plan without an element, whatever is heard of it", _FAIL_EPILOG),
        ("clear", "count an element as working again", _CLEAR_EPILOG),
        ("retire", "take an element out of service: what runs there moves first", _RETIRE_EPILOG),
        ("restore", "take an element back into service after 'heronry retire'", _RESTORE_EPILOG),
        ("traceback", "show the traceback of a module's last failure", _TRACEBACK_EPILOG),
        ("unlock", "let CANopen tools write to a PE for half a minute", _UNLOCK_EPILOG),
    ):
        parser = _parser(subparsers, name, sentence, epilog)
        parser.add_argument(
            "what", metavar="ELEMENT", help="KIND:NAME, for example pe:nav, device:gps, module:autopilot"
        )
        if name == "traceback":
            add_output(parser, "print the answer as one JSON object")
        else:
            add_json(parser)


def _parser(subparsers: Any, name: str, sentence: str, epilog: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name,
        description=f"{sentence[0].upper()}{sentence[1:]}: an order to the manager that runs on this computer.",
        epilog=epilog,
    )
    add_manager_argument(parser)
    parser.set_defaults(order=name)
    return parser


def _priority(text: str) -> int | str:
    if text == "default":
        return text
    if not text.isascii() or not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is no priority; write a whole number from 0 to 32767, or default")
    return int(text)
