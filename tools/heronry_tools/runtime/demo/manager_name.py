"""The name under which `heronry status` and the operator's orders find the manager of a demo: `--of NAME`.

It is the name of the spec with "-demo"; if a demo of the same spec runs already, with "-demo-2", and so on. A demo
holds the lock of its name, a file in the folder of the sockets. The kernel releases the lock, however the demo ends.
"""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

from heronry_manager.shell.control_place import (
    STANDBY,
    ControlError,
    checked_length,
    default_socket,
    listening_folder,
)


@contextmanager
def manager_name(spec_name: str) -> Iterator[str | None]:
    """Hold a free name for the manager of a demo while the `with` block runs.

    Gives None if the user's folder of sockets cannot be used.
    """
    try:
        folder = listening_folder(checked_length(default_socket(f"{spec_name}-demo-999{STANDBY}")))
    except ControlError:
        yield None
        return
    for number in count(1):
        name = f"{spec_name}-demo" if number == 1 else f"{spec_name}-demo-{number}"
        with (folder / f"{name}.claim").open("w") as claim:
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield name
            return
