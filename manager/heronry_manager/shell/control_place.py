"""Where a running manager of this computer listens to its operator: one socket for each spec.

    $XDG_RUNTIME_DIR/heronry/SPEC.sock, or /tmp/heronry-UID/SPEC.sock where there is no XDG_RUNTIME_DIR

Only its owner may enter the folder, and any other folder is refused: a process that can reach the socket commands the
aircraft.
"""

import os
import stat
import tempfile
from pathlib import Path

from heronry_wire.errors import HeronryError

_LONGEST_PATH_BYTES = 107  # of the address of a UNIX-domain socket on Linux: 108 with its end


class ControlError(HeronryError):
    """A manager cannot be called, or cannot listen; the message is one sentence with the remedy."""


def default_folder() -> Path:
    """Folder of this user's sockets."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "heronry" if runtime else Path(tempfile.gettempdir()) / f"heronry-{os.getuid()}"


def default_socket(spec_name: str) -> Path:
    """Socket of the manager of a spec."""
    return default_folder() / f"{spec_name}.sock"


def owned_folder(folder: Path) -> Path:
    """Make a folder that only its owner can enter, or check that it is one; raises ControlError."""
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
    """Give the path if it fits into an address; raises ControlError."""
    if len(os.fsencode(path)) > _LONGEST_PATH_BYTES:
        raise ControlError(f"{path} is longer than {_LONGEST_PATH_BYTES} bytes: name a shorter one with --socket")
    return path
