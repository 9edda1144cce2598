"""The command line of `heronry adopt`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.output import add_json
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments
from heronry_wire.identifiers import PE_NODES

_EPILOG = """\
The node must wait for a table (pe-agent --node). The lines name all that its computer has: give modules less of it
where other programs run there. When the spec has the PE, restart the manager, and the node is brought its table.

examples:
  pe-agent --node 101 -i socketcan -c can0                    on the node
  heronry adopt big_blue 101 -i socketcan -c can0             on any other node of that bus
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry adopt`."""
    parser = subparsers.add_parser(
        "adopt",
        description="Ask a node that the spec does not have what it offers, and write the lines of the spec for it.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("node", type=_node, metavar="NODE", help="its node-ID, 92 to 125")
    add_json(parser, "write the offer as JSON")
    add_bus_arguments(parser, "the bus on which the node waits")


def _node(text: str) -> int:
    if text.isascii() and text.isdecimal() and int(text) in PE_NODES:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text} is not the node-ID of a PE; use {PE_NODES[0]} to {PE_NODES[-1]}")
