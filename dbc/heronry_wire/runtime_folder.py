"""The folder in which the programs of one user find each other's sockets.

    $XDG_RUNTIME_DIR/heronry, or /tmp/heronry-UID where this user has no such directory

In this folder a manager listens on SPEC.sock, and a software bus on NAME.bus. A process that reaches these sockets can
command the aircraft. So no program listens on, or connects to, a socket in a folder that belongs to another user or
that others can write to: any user can make /tmp/heronry-UID first. An XDG_RUNTIME_DIR of another user (sudo keeps the
variable) is ignored.
"""

import os
import stat
import tempfile
from pathlib import Path

from heronry_wire.errors import HeronryError

_OTHERS_WRITE = 0o022


class RuntimeFolderError(HeronryError):
    """The folder for the sockets of this user's programs cannot be used; the message says why."""


def runtime_folder() -> Path:
    """Return the path of the folder in which this user's programs find each other's sockets.

    The folder need not exist, and its owner and access rights are not verified.
    """
    named = os.environ.get("XDG_RUNTIME_DIR")
    if named and _belongs_to_this_user(Path(named)):
        return Path(named) / "heronry"
    return Path(tempfile.gettempdir()) / f"heronry-{os.getuid()}"


def owned_folder(folder: Path) -> Path:
    """Create a folder that only this user can enter, or accept an existing folder as `trusted_folder` does.

    Raises RuntimeFolderError.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise RuntimeFolderError(f"the folder {error.filename or folder} cannot be made ({error.strerror})") from error
    return trusted_folder(folder)


def trusted_folder(folder: Path) -> Path:
    """Return `folder` if it belongs to this user and no other user can write to it, or if it does not exist.

    Raises RuntimeFolderError for any other folder.
    """
    try:
        found = folder.lstat()
    except FileNotFoundError:
        return folder
    except OSError as error:
        raise RuntimeFolderError(f"the folder {folder} cannot be looked at ({error.strerror})") from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & _OTHERS_WRITE:
        raise RuntimeFolderError(f"{folder} does not belong to you, or other users can write to it")
    return folder


def _belongs_to_this_user(folder: Path) -> bool:
    try:
        return folder.stat().st_uid == os.getuid()
    except OSError:
        return False
