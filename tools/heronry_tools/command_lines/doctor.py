"""The command line of `heronry doctor`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output
from heronry_wire.bus_arguments import add_bus_arguments

_EPILOG = """\
examples:
  heronry doctor -i socketcan -c can0                      the interface, and what is heard on it
  heronry doctor my.dg.yaml -i socketcan -c can0           ... and whether the PEs are those of this spec
  heronry doctor /etc/heronry/nav.table -i socketcan -c can0     on a node, which has only its table
  heronry doctor my.dg.yaml -i socketcan -c can0 --wait 60       after everything was started
  heronry doctor twin.dg.yaml -i socketcan -c can0,can1          a bus with 'channels: 2': which PEs are on only one
  heronry doctor -i socketcan -c can0 --json | jq .findings

The command listens on the bus, and reads from each PE that it hears, by SDO, the digest of the spec of its table. It
sends no commands. Do not use it in flight: there the manager is the only SDO client.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry doctor`."""
    parser = subparsers.add_parser(
        "doctor",
        description="Check this computer, its CAN interface, and what is heard on the bus.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "spec", metavar="SPEC", nargs="?", help="what should be on the bus: a spec, or the *.table of a PE"
    )
    parser.add_argument("--seconds", type=float, default=3.0, metavar="S", help="seconds to listen (default 3)")
    parser.add_argument(
        "--wait", type=float, default=0.0, metavar="S", help="repeat until everything is right, for up to S seconds"
    )
    add_output(parser, "write the findings as JSON")
    add_bus_arguments(parser, "the bus")
