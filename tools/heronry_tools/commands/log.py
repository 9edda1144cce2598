"""`heronry log convert`: converts a recorded flight to MCAP or MDF 4, two formats that measurement tools read."""

import argparse
from pathlib import Path

from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.whole_file import expect_writable
from heronry_tools.sources.recordings import open_recording
from heronry_tools.watch.export.mcap_file import write_mcap
from heronry_tools.watch.export.mf4_file import write_mf4
from heronry_wire.key_file import read_key


def run(arguments: argparse.Namespace) -> int:
    """Convert a recorded flight; returns 0."""
    writers = {".mcap": write_mcap, ".mf4": write_mf4}
    file: Path = arguments.file
    if file.suffix.lower() not in writers:
        raise UserError(f"the ending of {file} names no format; name the file *.mcap or *.mf4")
    expect_writable(file)
    key = None if arguments.key is None else read_key(arguments.key)
    draft = file.with_name(f".{file.stem}.new{file.suffix}")
    with Working(f"converting {arguments.recording}"):
        recording = open_recording(arguments.recording, arguments.spec, key)
        try:
            writers[file.suffix.lower()](recording, recording.timeline().last().reconfigurations, draft)
            draft.replace(file)
        finally:
            draft.unlink(missing_ok=True)
    print(f"{file}: {len(recording.frames)} frames, {len(recording.events)} events")
    return 0
