"""`heronry key`: the key with which a fleet proves what it says (protocol rule 11)."""

import argparse
from pathlib import Path
from typing import Any

_EPILOG = """\
examples:
  heronry key fleet.key                          a new key, for its owner's eyes alone (mode 0600)
  heronry key --check fleet.key                  which one is it? compare the fingerprints of all nodes
  heronry manager my.dg.yaml --key fleet.key -i socketcan -c can0
  pe-agent --table nav.table --key fleet.key -i socketcan -c can0

One key serves manager and PEs of a fleet. Carry it to each node by a way that you trust, never over the bus. Make a new
one when a node is lost, and when a manager has lost its --state-dir: it would count its commands from the start again.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry key`."""
    parser = subparsers.add_parser(
        "key",
        help="make the key with which manager and PEs prove what they say",
        description="Make a key in a new file, and tell its fingerprint.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="where the key is")
    parser.add_argument("--check", action="store_true", help="make none; tell the fingerprint of the one that is there")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make a key, or look at one; returns the exit code."""
    from heronry_wire.key_file import make_key, read_key  # noqa: PLC0415 - as in every command

    key = read_key(arguments.file) if arguments.check else make_key(arguments.file)
    print(f"{arguments.file}: key {key.fingerprint}")
    return 0
