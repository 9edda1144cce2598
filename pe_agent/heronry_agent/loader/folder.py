"""The files of a store in one folder: each is replaced as a whole, in two steps.

    draft     writes the new content beside the file, down to the disk; a crash leaves the old file, and a draft that
              counts as nothing
    commit    moves the draft to its place; a crash leaves the old file or the new one, and both are whole

    remove    lets a file be no more

All raise OSError where the disk is full, read-only or broken.
"""

import os
from contextlib import suppress
from pathlib import Path

from heronry_wire.ordinary_file import move_ordinary, open_ordinary, read_ordinary

_DRAFT = ".new"


class Folder:
    """The folder in which a store keeps its files."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self) -> None:
        """Make the folder where there is none, and remove the drafts that a crash has left."""
        self.path.mkdir(parents=True, exist_ok=True)
        for draft in self.path.glob(f"*{_DRAFT}"):
            draft.unlink()

    def read(self, name: str, most_bytes: int) -> bytes | None:
        """Return the first `most_bytes` bytes of a file; None where there is no such file."""
        with suppress(FileNotFoundError):
            return read_ordinary(self.path / name, most_bytes)
        return None

    def draft(self, name: str, content: bytes) -> None:
        """Write the content that a file is to have; the file itself stays as it is."""
        with os.fdopen(open_ordinary(self._draft_of(name)), "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())

    def commit(self, name: str) -> None:
        """Let a file have the content of its draft."""
        move_ordinary(self._draft_of(name), self.path / name)

    def remove(self, name: str) -> None:
        """Let there be no such file."""
        (self.path / name).unlink(missing_ok=True)

    def _draft_of(self, name: str) -> Path:
        return self.path / f"{name}{_DRAFT}"
