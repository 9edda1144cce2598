"""The place of the socket on which a manager of this computer takes orders: one for each spec.

    SPEC.sock in this user's `heronry_wire.runtime_folder`, or the path that --socket names

The folder of a socket must belong to this user, and other users must not be able to write to it. Any other folder is
refused, because a process that can reach the socket can command the aircraft.
"""

import os
import socket
import struct
from pathlib import Path
from typing import Final

from heronry_wire.errors import HeronryError
from heronry_wire.runtime_folder import RuntimeFolderError, owned_folder, runtime_folder, trusted_folder

STANDBY: Final = "-standby"  # behind the name of a spec: the socket of its standby manager
_CREDENTIALS = struct.Struct("3i")  # process, user, group: man 7 unix, SO_PEERCRED
_LONGEST_PATH_BYTES = 107  # of a UNIX-domain socket's address on Linux: 108 with the final zero


class ControlError(HeronryError):
    """A manager cannot be called, or cannot listen; the message is one sentence with the remedy."""


def default_socket(spec_name: str) -> Path:
    """Return the path of the socket for the manager of this spec."""
    return runtime_folder() / f"{spec_name}.sock"


def standby_of(path: Path) -> Path:
    """Return the path of the standby manager's socket, beside the given socket of an active manager."""
    return path.with_name(f"{path.stem}{STANDBY}{path.suffix}")


def active_of(path: Path) -> Path:
    """Return the path of the active manager's socket, beside the given one, which may be the standby manager's."""
    return path.with_name(f"{path.stem.removesuffix(STANDBY)}{path.suffix}")


def listening_folder(path: Path) -> Path:
    """Make the folder of a socket if needed, and return it.

    Raises ControlError if another user owns the folder or can write to it.
    """
    try:
        return owned_folder(path.parent)
    except RuntimeFolderError as error:
        raise ControlError(f"{error}: name a socket in a folder of your own with --socket") from error


def found_sockets() -> list[Path]:
    """List the sockets of managers in this user's folder.

    Raises ControlError if another user owns the folder or can write to it.
    """
    try:
        return sorted(trusted_folder(runtime_folder()).glob("*.sock"), key=lambda path: path.stem)
    except RuntimeFolderError as error:
        raise ControlError(f"{error}: name the manager's socket with --socket") from error


def checked_length(path: Path) -> Path:
    """Return `path` back if it fits into a socket address; raises ControlError if it is too long."""
    if len(os.fsencode(path)) > _LONGEST_PATH_BYTES:
        raise ControlError(f"{path} is longer than {_LONGEST_PATH_BYTES} bytes: name a shorter path with --socket")
    return path


def user_beyond(connection: socket.socket) -> int:
    """Return the user-ID of the process at the other end of a connection, as the kernel knows it."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(credentials)[1])
