"""The last term of a manager's reign, kept on disk so that a restart starts a newer one.

The file is replaced as a whole and fsynced before the manager speaks: a crash at any byte leaves the old term or the
new one. A file that cannot be read is an error for the user, not a reason to start again at 1: PEs would reject it.
"""

import os
from pathlib import Path

from heronry_wire.errors import HeronryError
from heronry_wire.management import MAX_TERM


class TermError(HeronryError):
    """The term cannot be read or kept; the message is one sentence with the remedy."""


def next_term(folder: Path) -> int:
    """Give the term after the last one in `folder` and keep it there; raises TermError."""
    file = folder / "manager.term"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = file.read_text() if file.exists() else "0"
        if not text.strip().isdecimal():
            raise TermError(f"{file} does not hold a number; remove it, and restart the PEs so that they accept term 1")
        term = int(text) + 1
        if term > MAX_TERM:
            raise TermError(f"{file} holds the last term there is; remove it, and restart the PEs")
        _replace(file, f"{term}\n")
    except OSError as error:
        raise TermError(f"{error.filename or file}: {error.strerror}; name another folder with --state-dir") from error
    return term


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
