"""The boot count of a PE, 0..255, which shows other nodes a restart, even within one heartbeat period.

If the count is kept in a folder, it goes up by one with each start. Its file is replaced as a whole and fsynced before
the agent sends its first frame, so a crash at any moment leaves the old number or the new one. Without a folder, or if
the file does not hold a number, the count is drawn at random, and one restart in 256 is not recognized.
"""

import os
from pathlib import Path
from secrets import randbelow

from heronry_wire.errors import HeronryError

_INCARNATIONS = 256


class IncarnationError(HeronryError):
    """The file of the boot count cannot be written; the message is one sentence with the remedy."""


def next_incarnation(folder: Path | None, node: int) -> int:
    """Give the boot count of this start, and write it to `folder` if that is given; raises IncarnationError."""
    if folder is None:
        return _drawn()
    file = folder / f"pe-{node}.incarnation"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = file.read_text(errors="replace").strip() if file.exists() else ""
        incarnation = (int(text) + 1) % _INCARNATIONS if text.isascii() and text.isdecimal() else _drawn()
        _replace(file, f"{incarnation}\n")
    except OSError as error:
        raise IncarnationError(
            f"{error.filename or file}: {error.strerror}; name a folder that can be written with --state-dir"
        ) from error
    return incarnation


def _drawn() -> int:
    return randbelow(_INCARNATIONS)


def _replace(file: Path, text: str) -> None:
    draft = file.with_suffix(".new")
    with draft.open("w") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    draft.replace(file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
