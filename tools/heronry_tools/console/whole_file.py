"""Files that are written whole or not at all.

A result is written at the end: first into a draft beside the file; then the draft replaces the file in one step. A
result may take minutes, so the command checks at the start whether the file can be written. A folder is refused. A
device is refused, too, since the draft would replace the device file.
"""

import os
from pathlib import Path

from heronry_tools.console.errors import UserError
from heronry_wire import interruption
from heronry_wire.ordinary_file import replace_ordinary


def expect_writable(file: Path) -> None:
    """Raise UserError where `write_whole` could not write this file."""
    if not file.parent.is_dir():
        raise UserError(f"{file.parent} is not a folder; make this folder first, or name another file")
    if file.exists() and not file.is_file():
        raise UserError(f"{file} is {'a folder' if file.is_dir() else 'not an ordinary file'}; name another file")
    if not os.access(file.parent, os.W_OK):
        raise UserError(f"you may not write in the folder {file.parent}; name another file")


def write_whole(file: Path, data: bytes) -> None:
    """Write a file; a reader, even after a crash, finds either all of the new content or the old file.

    Raises UserError if the file cannot be written, and `Interrupted` if the command was interrupted while it computed
    the data. In both cases the old file stays.
    """
    interruption.expect_none()
    expect_writable(file)
    try:
        replace_ordinary(file.resolve(), data)  # the target of a link is replaced, and the link stays
    except OSError as error:
        raise UserError(f"{file} cannot be written: {error.strerror}; make room, or name another file") from error
