"""An operator's call to a running manager: one order, one answer."""

import socket
from pathlib import Path

from heronry_manager.core.vocabulary import Order
from heronry_manager.shell.control_place import ControlError, checked_length, default_folder, default_socket
from heronry_manager.shell.control_protocol import Answer, order_line, read_answer

PATIENCE_S = 5.0  # a manager answers within a turn of its loop, if its process is not stopped


def call(path: Path, order: Order) -> Answer:
    """Give an order to the manager on a socket; raises ControlError if no manager answers."""
    checked_length(path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(PATIENCE_S)
        try:
            line.connect(str(path))
            line.sendall(order_line(order))
            with line.makefile("rb") as replies:
                answer = read_answer(replies.readline())
        except TimeoutError:
            raise ControlError(f"the manager on {path} does not answer within {PATIENCE_S:.0f} s: restart it") from None
        except (FileNotFoundError, ConnectionError):
            raise ControlError(f"no manager listens on {path}: start one with 'heronry manager SPEC'") from None
        except OSError as error:
            raise ControlError(f"{path}: {error.strerror}") from error
    if answer is None:
        raise ControlError(f"the process that answers on {path} is no manager of this version of heronry")
    return answer


def find_socket(spec_name: str | None) -> Path:
    """Give the socket of a spec's manager; without a name, of the only running manager. Raises ControlError."""
    if spec_name is not None:
        return default_socket(spec_name)
    found = sorted(default_folder().glob("*.sock"))
    if not found:
        raise ControlError(
            f"no manager runs here: there is no socket in {default_folder()}; start one with 'heronry manager SPEC', "
            "or name its socket with --socket"
        )
    if len(found) > 1:
        names = ", ".join(file.stem for file in found)
        raise ControlError(f"there are {len(found)} managers: {names}; say which one with --of NAME")
    return found[0]
