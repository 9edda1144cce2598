"""An operator's call to a running manager: one order, one answer.

Any process can listen at a path that is not protected. So a caller gives its order only to a process of its own user or
of root. If the caller itself is root, it gives the order to any process, since root may use the managers of all users.
"""

import os
import socket
from pathlib import Path

from heronry_manager.core.vocabulary import AskTraceback
from heronry_manager.shell.control_place import ControlError, checked_length, default_socket, found_sockets, user_beyond
from heronry_manager.shell.control_protocol import LONGEST_ORDER_BYTES, Answer, Follow, Spoken, order_line, read_answer

PATIENCE_S = 5.0  # a manager answers within a turn of its loop, if its process is not stopped


TRACEBACK_PATIENCE_S = 30.0  # for a traceback: a PE sends it in a tenth of the bus, which may be slow


def call(path: Path, order: Spoken) -> Answer:
    """Give an order to the manager on a socket; raises ControlError if no manager of this user or of root answers."""
    checked_length(path)
    request = order_line(order)
    if len(request) > LONGEST_ORDER_BYTES:
        raise ControlError(
            f"the order has {len(request)} bytes, and a manager takes at most {LONGEST_ORDER_BYTES}: make the script "
            "shorter, or give its parts one after the other"
        )
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        patience_s = TRACEBACK_PATIENCE_S if isinstance(order, AskTraceback) else PATIENCE_S
        line.settimeout(patience_s)
        try:
            line.connect(str(path))
            _expect_own_process(line, path)
            line.sendall(request)
            with line.makefile("rb") as replies:
                answer = read_answer(replies.readline())
        except TimeoutError:
            raise ControlError(f"the manager on {path} does not answer within {patience_s:.0f} s: restart it") from None
        except (BrokenPipeError, ConnectionResetError):
            raise ControlError(
                f"the manager on {path} has closed the connection: it has ended, or has too many callers; try again"
            ) from None
        except (FileNotFoundError, ConnectionError):
            raise ControlError(f"no manager listens on {path}: start one with 'heronry manager SPEC'") from None
        except OSError as error:
            raise ControlError(f"{path}: {error.strerror}") from error
    if answer is None:
        raise ControlError(
            f"the process that answers on {path} is no manager of this version of heronry; "
            "restart the manager with this version"
        )
    return answer


def follow(path: Path) -> socket.socket:
    """Begin to read the events of the manager on a socket.

    The returned socket gives JSON lines: a status, and events (`followers`). The caller closes the socket. Raises
    ControlError if no manager of this user or of root listens.
    """
    checked_length(path)
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    line.settimeout(PATIENCE_S)
    try:
        line.connect(str(path))
        _expect_own_process(line, path)
        line.sendall(order_line(Follow()))
    except ControlError:
        line.close()
        raise
    except OSError:
        line.close()
        raise ControlError(f"no manager listens on {path}: start one with 'heronry manager SPEC'") from None
    line.settimeout(None)
    return line


def find_socket(name: str | None) -> Path:
    """Return the socket of the manager with this name; without a name, the socket of the only running manager.

    Raises ControlError if managers run but none of them has this name, or if, without a name, not exactly one runs.
    """
    running = running_sockets()
    names = ", ".join(path.stem for path in running)
    if name is not None:
        path = default_socket(name)
        if running and path not in running:
            raise ControlError(f"no manager listens on {path}; these run here: {names}")
        return path
    if not running:
        raise ControlError(
            f"no manager runs here: none listens in {default_socket('any').parent}; start one with 'heronry manager "
            "SPEC', or name the socket of a running one with --socket"
        )
    if len(running) > 1:
        raise ControlError(f"there are {len(running)} managers: {names}; say which one with --of NAME")
    return running[0]


def running_sockets() -> list[Path]:
    """List the sockets in this user's folder on which a manager listens, by name.

    Raises ControlError if another user owns the folder or can write to it.
    """
    return [path for path in found_sockets() if is_listened_on(path)]


def is_listened_on(path: Path) -> bool:
    """Tell whether a process listens on the socket at a path.

    A socket without a process may be left there, since a manager that is killed does not remove its socket.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(PATIENCE_S)
        try:
            line.connect(str(path))
        except TimeoutError:
            return True
        except OSError:
            return False
    return True


def _expect_own_process(line: socket.socket, path: Path) -> None:
    user = user_beyond(line)
    if os.getuid() not in (0, user) and user != 0:
        raise ControlError(
            f"the process that listens on {path} is another user's (user ID {user}), so nothing is sent to it; "
            "give the command as that user, or name another socket with --socket"
        )
