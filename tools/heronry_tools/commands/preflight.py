"""`heronry preflight`: all that must hold before take-off, in one list, with what to type where it does not.

Exit codes: 0 go, 1 no go, 2 it cannot be judged: no manager answers, or what was typed cannot be used.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.manager_argument import add_manager_argument, manager_socket
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument

if TYPE_CHECKING:
    from heronry_tools.reports.findings import Finding

_PAUSE_S = 0.5
_EPILOG = """\
examples:
  heronry preflight big_blue                               the manager on this computer, and its bus
  heronry preflight big_blue --wait 60                     after everything was started
  heronry preflight big_blue --key fleet.key               ... and whether all use this key
  heronry preflight big_blue --of big_blue-demo            the demo beside this
  heronry preflight big_blue --bus radio=slcan:/dev/ttyUSB0     listens to the radio, too
  heronry preflight big_blue && heronry phase ascent       GO is exit code 0

The manager must run on this computer; 'heronry doctor' is the part that needs no manager. The command listens on the
manager's bus, which the manager names, and on those that you name; it sends nothing but questions to PEs (SDO). Before
take-off, not in flight: there the manager is the only SDO client.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry preflight`."""
    from heronry_wire.bus_arguments import add_bus_arguments  # noqa: PLC0415 - python-can is slow to import

    parser = subparsers.add_parser(
        "preflight",
        description="Check all that must hold before take-off, and say GO or NO GO.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--seconds", type=float, default=3.0, metavar="S", help="least time to listen (default 3 s)")
    parser.add_argument("--wait", type=float, default=0.0, metavar="S", help="repeat until GO, for up to S seconds")
    parser.add_argument("--key", type=Path, metavar="FILE", help="key file that the manager and all PEs must use")
    parser.add_argument(
        "--bus",
        metavar="NAME=[INTERFACE:]CHANNEL",
        action="append",
        default=[],
        help="a bus of SPEC to listen to; may be repeated",
    )
    add_manager_argument(parser)
    add_output(parser, "write the findings as JSON")
    add_bus_arguments(parser, "the manager's bus, where the manager does not name it")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Inspect and report; returns 0 for GO, 1 for NO GO."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - with all below slow to import
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.preflight.inspection import Inspection  # noqa: PLC0415
    from heronry_tools.reports.findings import all_right, as_json, as_text  # noqa: PLC0415
    from heronry_tools.sources.opened import named_choices  # noqa: PLC0415
    from heronry_wire.key_file import read_key  # noqa: PLC0415

    if not 0 < arguments.seconds <= 600:
        raise UserError(f"--seconds {arguments.seconds:g}: listen for more than 0 and up to 600 s")
    spec = load_spec(arguments.spec)
    key = None if arguments.key is None else read_key(arguments.key)
    buses = list(named_choices(spec, arguments))

    def inspected() -> "list[Finding]":
        socket = manager_socket(arguments)
        return Inspection(spec, arguments.spec, socket, buses, arguments.seconds, key).findings()

    findings = _as_soon_as_right(inspected, time.monotonic() + arguments.wait)
    print(as_json(findings) if arguments.json else "\n".join(as_text(findings, "GO", "NO GO: ")))
    return 0 if all_right(findings) else 1


def _as_soon_as_right(inspected: Callable[[], "list[Finding]"], until_s: float) -> "list[Finding]":
    """Inspect until everything is right, or until a time of the monotonic clock; gives the last findings.

    Raises ControlError if no manager answers by then.
    """
    from heronry_manager.shell.control_place import ControlError  # noqa: PLC0415
    from heronry_tools.reports.findings import all_right  # noqa: PLC0415

    while True:
        is_over = time.monotonic() >= until_s
        try:
            findings = inspected()
        except ControlError:
            if is_over:
                raise
        else:
            if is_over or all_right(findings):
                return findings
        time.sleep(_PAUSE_S)
