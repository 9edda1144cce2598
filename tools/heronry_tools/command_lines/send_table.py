"""The command line of `heronry send-table`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.contingencies_argument import CARRIED, add_contingencies_argument
from heronry_tools.console.output import add_json
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments

_EPILOG = """\
examples:
  pe-agent --node 92 -i socketcan -c can0                        on the PE: it waits
  heronry send-table big_blue flight -i socketcan -c can0        on any other node of that bus
  heronry send-table big_blue flight -i socketcan -c can0 --key fleet.key    where both have a key: beside the manager

A manager brings tables by itself; this command is for a desk without one.
The table goes by SDO block transfer into object 2020h. A PE that flies keeps what comes beside its own table.
With a key the manager, which must run on this computer, unlocks the PE first, as with 'heronry unlock'.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry send-table`."""
    parser = subparsers.add_parser(
        "send-table",
        description="Compile the table of a PE and write it into the PE by SDO.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("pe", metavar="PE", help="name of the PE")
    add_contingencies_argument(parser, CARRIED)
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="the key file from 'heronry key', if the PE was started with a key"
    )
    parser.add_argument(
        "--socket",
        type=Path,
        metavar="PATH",
        help="with --key: the manager's socket, if the manager was started with --socket",
    )
    add_json(parser, "write what was sent as JSON")
    add_bus_arguments(parser, "the bus that is the uplink of the PE; either channel of a replicated one")
