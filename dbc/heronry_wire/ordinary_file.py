"""Files that a node keeps or a command writes: read without waiting, and replaced as a whole.

After a crash the place holds either the old file or the new one. The place may hold something that is not a file: a
pipe would make `open` wait for ever, and a folder cannot be replaced. Both raise OSError, as a full disk and a
read-only disk do; its text can be shown in a message.
"""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

_NOT_ORDINARY = "this is not an ordinary file"


def read_ordinary(file: Path, most_bytes: int | None = None) -> bytes:
    """Read a file, or its first `most_bytes` bytes; raises OSError, FileNotFoundError where there is no file."""
    with os.fdopen(_opened(file, os.O_RDONLY), "rb") as stream:
        return stream.read(most_bytes)


def open_ordinary(file: Path) -> int:
    """Open a new, empty file for writing, in place of an old one; gives its descriptor, or raises OSError."""
    descriptor = _opened(file, os.O_WRONLY | os.O_CREAT)
    os.ftruncate(descriptor, 0)
    return descriptor


def replace_ordinary(file: Path, data: bytes) -> None:
    """Replace a file by one with this content; when the function returns, the content is on the disk. Raises OSError.

    If it fails or is interrupted, the old file stays, and nothing else is left behind.
    """
    draft = file.with_name(f"{file.name}.new")
    try:
        with os.fdopen(open_ordinary(draft), "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        move_ordinary(draft, file)
    except BaseException:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        raise


def move_ordinary(draft: Path, file: Path) -> None:
    """Put a finished draft in the place of a file, durably; raises OSError where no ordinary file is there."""
    if file.exists() and not file.is_file():
        raise OSError(errno.EINVAL, _NOT_ORDINARY, str(file))
    draft.replace(file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _opened(file: Path, flags: int) -> int:
    """Open a file without waiting for the other end of a pipe."""
    descriptor = os.open(file, flags | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, _NOT_ORDINARY, str(file))
    return descriptor
