"""The command line of `heronry key`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_json

_EPILOG = """\
examples:
  heronry key fleet.key                          a new key that only its owner can read (mode 0600)
  heronry key --check fleet.key                  its fingerprint, to compare with those of all nodes
  heronry key --signing fleet.signing            another key, which signs code; fleet.signing.pub is for each PE
  heronry manager my.dg.yaml --key fleet.key -i socketcan -c can0
  pe-agent --table nav.table --key fleet.key -i socketcan -c can0

One key serves manager and PEs of a fleet. Carry it to each node by a way that you trust, never over the bus. Make a new
one when a node is lost, and when a manager has lost its --state-dir: that manager would number its commands from 1
again.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry key`."""
    parser = subparsers.add_parser(
        "key",
        description="Make a key in a new file, and print its fingerprint.",
        epilog=_EPILOG,
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="the file of the key")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="make no key; print the fingerprint of the key in FILE")
    what.add_argument(
        "--signing", action="store_true", help="make a key that signs code (heronry bundle), and FILE.pub for each PE"
    )
    add_json(parser, "write the fingerprint as JSON")
