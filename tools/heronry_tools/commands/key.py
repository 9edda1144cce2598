"""`heronry key`: the key with which manager and PEs authenticate their frames (protocol rule 11)."""

import argparse
import json
from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_json

_EPILOG = """\
examples:
  heronry key fleet.key                          a new key that only its owner can read (mode 0600)
  heronry key --check fleet.key                  its fingerprint, to compare with those of all nodes
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
    parser.add_argument("--check", action="store_true", help="make no key; print the fingerprint of the key in FILE")
    add_json(parser, "write the fingerprint as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make a key, or print the fingerprint of one; returns the exit code."""
    from heronry_wire.key_file import make_key, read_key  # noqa: PLC0415 - as in every command

    key = read_key(arguments.file) if arguments.check else make_key(arguments.file)
    told = {"file": str(arguments.file), "fingerprint": key.fingerprint}
    print(json.dumps(told) if arguments.json else f"{arguments.file}: key {key.fingerprint}")
    return 0
