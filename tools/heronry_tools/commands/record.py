"""`heronry record`: a flight recorder, which writes the frames and events of a flight into rotating files."""

import argparse
import re
import select
import time
from pathlib import Path
from typing import Any

from heronry_tools.sources.arguments import add_source_arguments
from heronry_wire.interruption import noted

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
    parser.set_defaults(run=run)


def size(text: str) -> int:
    """Read a size, such as 500M, and return it in bytes; raises ArgumentTypeError."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"{text} is not a size; write for example 500M or 2G")
    return int(match["number"]) * _UNITS[match["unit"]]


def run(arguments: argparse.Namespace) -> int:
    """Record until a signal comes, or until the time of --for is over; returns 0."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - with all below slow to import
    from heronry_tools.console.spec_argument import spec_path  # noqa: PLC0415
    from heronry_tools.sources.opened import opened_feed  # noqa: PLC0415
    from heronry_tools.watch.recorder import LEAST_BYTES, Recorder  # noqa: PLC0415

    if arguments.limit < LEAST_BYTES:
        raise UserError(
            f"--limit {arguments.limit} bytes is too small; the least is {LEAST_BYTES // 10**6}M (megabytes)"
        )
    feed = opened_feed(arguments)
    stopped = noted()
    end_s = None if arguments.seconds is None else time.monotonic() + arguments.seconds
    text = (feed.spec_file or spec_path(arguments.spec)).read_bytes()
    try:
        recorder = Recorder(arguments.folder, feed.spec, feed.source, text, arguments.limit)
        print(f"recording {feed.spec.name} into {arguments.folder}; Ctrl-C ends it", flush=True)
        begun_s, frames, count = time.monotonic(), 0, 0
        try:
            while not stopped and (end_s is None or time.monotonic() < end_s):
                select.select(feed.readers(), [], [], 0.1)
                events = feed.poll()
                recorder.write(feed.frames, events)
                frames, count = frames + len(feed.frames), count + len(events)
        finally:
            recorder.close()
        ended = "ended by a signal" if stopped else "the time is up"
        spent_s = time.monotonic() - begun_s
        print(f"{ended}: {arguments.folder} has the frames ({frames}) and events ({count}) of {spent_s:.0f} s")
    finally:
        feed.close()
    return 0
