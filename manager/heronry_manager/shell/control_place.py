"""The place of the socket on which a manager of this computer takes orders: one for each spec.

    $XDG_RUNTIME_DIR/heronry/SPEC.sock, or /tmp/heronry-UID/SPEC.sock where there is no XDG_RUNTIME_DIR

The folder must belong to this user, and be closed to others; any other folder is refused: a process that can reach the
socket can command the aircraft.
"""

import os
import stat
import tempfile
from pathlib import Path

from heronry_wire.errors import HeronryError

_LONGEST_PATH_BYTES = 107  # of a UNIX-domain socket's address on Linux: 108 with the final zero


class ControlError(HeronryError):
    """A manager cannot be called, or cannot listen; the message is one sentence with the remedy."""


def default_folder() -> Path:
    """Give the folder of this user's sockets."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "heronry" if runtime else Path(tempfile.gettempdir()) / f"heronry-{os.getuid()}"


def default_socket(spec_name: str) -> Path:
    """Give the socket of a spec's manager."""
    return default_folder() / f"{spec_name}.sock"


def owned_folder(folder: Path) -> Path:
    """Make a folder that only this user can enter, or check an existing one; raises ControlError."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise ControlError(f"{error.filename or folder}: {error.strerror}; name a socket with --socket") from error
    private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    if not private:
        raise ControlError(f"{folder} is not yours, or other users can write to it: name another socket with --socket")
    return folder


def checked_length(path: Path) -> Path:
    """Give the path back if it fits into a socket address; raises ControlError if it is too long."""
    if len(os.fsencode(path)) > _LONGEST_PATH_BYTES:
        raise ControlError(f"{path} is longer than {_LONGEST_PATH_BYTES} bytes: name a shorter one with --socket")
    return path
