"""The socket of a hub in the file system; at most one hub uses a path.

If there is a socket at the path already, a new hub tries to connect to it:

    the connection is refused    a hub that crashed has left the socket. The new hub replaces the socket
    the connection is accepted   another hub runs there. `Address` raises HubError

Trying and replacing happen under a lock on the folder. So two hubs that start together cannot both take the path.

`Address` also raises HubError if the folder does not exist or is not writable, or if the path leads to something other
than a socket. At the end the hub removes its socket, unless another hub has taken the path meanwhile.
"""

import fcntl
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from heronry_wire.errors import HeronryError

_PENDING_CONNECTIONS = 64


class HubError(HeronryError):
    """A hub cannot run at its path; the message says why and what to do."""


class Address:
    """A listening socket at a path of the file system, removed by `close`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with _folder_locked(path.parent):
                _clear(path)
                self.listener.bind(os.fspath(path))
                self.listener.listen(_PENDING_CONNECTIONS)
                self._inode = path.stat().st_ino
        except HubError:
            self.listener.close()
            raise
        except OSError as error:
            self.listener.close()
            reason = error.strerror or error
            raise HubError(f"no software bus can run at {path}: {reason}; choose another path") from error
        self.listener.setblocking(False)

    def close(self) -> None:
        """Stop listening and remove the socket."""
        with suppress(OSError), _folder_locked(self._path.parent):
            if self._path.stat().st_ino == self._inode:
                self._path.unlink()
        self.listener.close()


@contextmanager
def _folder_locked(folder: Path) -> Iterator[None]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _clear(path: Path) -> None:
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise HubError(f"{path} exists already and is not a socket; choose another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        probe.setblocking(False)
        try:
            probe.connect(os.fspath(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except BlockingIOError:
            pass  # it listens, and is busy
    raise HubError(f"a software bus runs at {path} already; use that bus, or choose another path")
