"""Files that a node keeps or a command writes: read without waiting, and replaced as a whole.

After a crash, the path of such a file leads either to the old file or to the new one. A path may also lead to something
that is not a file: a pipe would make `open` wait for ever, and a folder cannot be replaced. In both cases a function
here raises OSError, as for a full or read-only disk. The text of the error can be shown in a message.
"""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

_NOT_ORDINARY = "this is not an ordinary file"


def read_ordinary(file: Path, most_bytes: int | None = None) -> bytes:
    """Read a file, or its first `most_bytes` bytes.

    Raises FileNotFoundError if there is no file, and another OSError if it cannot be read or is not ordinary.
    """
    with os.fdopen(_opened(file, os.O_RDONLY), "rb") as stream:
        return stream.read(most_bytes)


def open_ordinary(file: Path) -> int:
    """Create a file, or empty an existing one, and open it for writing; gives its descriptor, or raises OSError."""
    descriptor = _opened(file, os.O_WRONLY | os.O_CREAT)
    os.ftruncate(descriptor, 0)
    return descriptor


def replace_ordinary(file: Path, data: bytes) -> None:
    """Replace the content of a file by `data`.

    When the function returns, the content is on the disk. If it fails (OSError) or is interrupted, the file keeps its
    old content, and no other file is left behind.
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
    """Move the finished file `draft` to the path `file`; when the function returns, the move is on the disk.

    Raises OSError where `file` exists and is not an ordinary file.
    """
    if file.exists() and not file.is_file():
        raise OSError(errno.EINVAL, _NOT_ORDINARY, str(file))
    draft.replace(file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _opened(file: Path, flags: int) -> int:
    """Open a file without waiting; raises OSError if it is no ordinary file, for example a pipe."""
    descriptor = os.open(file, flags | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, _NOT_ORDINARY, str(file))
    return descriptor
