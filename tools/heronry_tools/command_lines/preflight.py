"""The command line of `heronry preflight`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.manager_argument import add_manager_argument
from heronry_tools.console.output import add_output
from heronry_tools.console.source_arguments import add_listened_bus
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments

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
    parser = subparsers.add_parser(
        "preflight",
        description="Check all that must hold before take-off, and say GO or NO GO.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--seconds", type=float, default=3.0, metavar="S", help="least time to listen (default 3 s)")
    parser.add_argument("--wait", type=float, default=0.0, metavar="S", help="repeat until GO, for up to S seconds")
    parser.add_argument("--key", type=Path, metavar="FILE", help="key file that the manager and all PEs must use")
    add_listened_bus(parser)
    add_manager_argument(parser)
    add_output(parser, "write the findings as JSON")
    add_bus_arguments(parser, "the manager's bus, where the manager does not name it")
