"""`heronry log convert`: converts a recorded flight to MCAP or MDF 4, two formats that measurement tools read."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
examples:
  heronry log convert flight.log big_blue -o flight.mcap       for Foxglove, Lichtblick and PlotJuggler
  heronry log convert flight.log big_blue -o flight.mf4        for asammdf and other tools that read ASAM MDF 4
  heronry log convert FOLDER -o flight.mcap                    a folder of 'heronry record' holds its spec

Every variable of the spec is a signal MODULE.VARIABLE with its unit. PEs, buses and functions have signals, too; events
and reconfigurations are channels of their own. Needs: pip install "heronry[export]"
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry log`."""
    parser = subparsers.add_parser("log", description="Convert recorded flights.", epilog=_EPILOG)
    convert = parser.add_subparsers(metavar="convert", required=True).add_parser(
        "convert", description="Write a recorded flight as MCAP or MDF 4.", epilog=_EPILOG
    )
    convert.add_argument(
        "recording", metavar="FILE.log", type=Path, help="a candump log, a folder of 'heronry record', or a *.scenario"
    )
    add_spec_argument(convert, optional=True)
    convert.add_argument(
        "-o", "--output", dest="file", metavar="FILE", type=Path, required=True, help="*.mcap or *.mf4"
    )
    convert.add_argument(
        "--key", type=Path, metavar="FILE", help="key file that verifies the frames, if the flight has a key"
    )
    convert.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Convert a recorded flight; returns 0."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - with all below slow to import
    from heronry_tools.console.whole_file import expect_writable  # noqa: PLC0415
    from heronry_tools.sources.recordings import open_recording  # noqa: PLC0415
    from heronry_tools.watch.export.mcap_file import write_mcap  # noqa: PLC0415
    from heronry_tools.watch.export.mf4_file import write_mf4  # noqa: PLC0415
    from heronry_wire.key_file import read_key  # noqa: PLC0415

    writers = {".mcap": write_mcap, ".mf4": write_mf4}
    file: Path = arguments.file
    if file.suffix.lower() not in writers:
        raise UserError(f"the ending of {file} names no format; name the file *.mcap or *.mf4")
    expect_writable(file)
    key = None if arguments.key is None else read_key(arguments.key)
    recording = open_recording(arguments.recording, arguments.spec, key)
    draft = file.with_name(f".{file.stem}.new{file.suffix}")
    try:
        writers[file.suffix.lower()](recording, recording.timeline().last().reconfigurations, draft)
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    print(f"{file}: {len(recording.frames)} frames, {len(recording.events)} events")
    return 0
