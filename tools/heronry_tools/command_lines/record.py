"""The command line of `heronry record`: arguments, their help, and examples."""

import argparse
import re
from pathlib import Path
from typing import Any

from heronry_tools.console.source_arguments import add_source_arguments

_EPILOG = """\
examples:
  heronry record -o flight                          the manager on this computer, and its bus
  heronry record big_blue -i socketcan -c can0 -o /var/lib/heronry/flight --limit 2G
  heronry record -o flight --for 60                 a minute
  heronry record -o flight --of big_blue-demo       where several managers run

The folder holds candump logs, events as JSON lines, the spec, and the versions. It never exceeds the limit: the oldest
files go. 'heronry top --log FOLDER', 'heronry replay FOLDER SPEC' and 'heronry log convert FOLDER' open it. Ctrl-C or
SIGTERM ends the recording. Nothing is ever sent on a bus.
"""
_SIZE = re.compile(r"(?P<number>\d{1,12})(?P<unit>[kMGT]?)B?", re.ASCII)
_UNITS = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry record`."""
    parser = subparsers.add_parser(
        "record", description="Record a flight into a folder of limited size.", epilog=_EPILOG
    )
    parser.add_argument(
        "-o", "--output", dest="folder", metavar="FOLDER", type=Path, required=True, help="a new folder"
    )
    parser.add_argument(
        "--limit", metavar="SIZE", type=size, default=10**9, help="largest size of the folder, e.g. 500M (default 1G)"
    )
    parser.add_argument(
        "--for", dest="seconds", metavar="SECONDS", type=float, help="end after this time (default: at Ctrl-C)"
    )
    add_source_arguments(parser, is_live=True)


def size(text: str) -> int:
    """Read a size, such as 500M, and return it in bytes; raises ArgumentTypeError."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"{text} is not a size; write for example 500M or 2G")
    return int(match["number"]) * _UNITS[match["unit"]]
