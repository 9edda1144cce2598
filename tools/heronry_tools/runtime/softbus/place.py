"""Where a software bus is: a path, or a name that all programs of one user find.

    with a slash      a path: /tmp/can0.sock, ./can0.sock
    without a slash   a name: can0 is can0.bus in the user's `heronry_wire.runtime_folder`

So `-i softbus -c can0` in any terminal finds the bus that `heronry softbus` has started in another one.
"""

import re
from collections.abc import Callable
from pathlib import Path

from heronry_wire.errors import HeronryError
from heronry_wire.runtime_folder import RuntimeFolderError, owned_folder, runtime_folder, trusted_folder

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,31}", re.ASCII)
_SUFFIX = ".bus"


class BusNameError(HeronryError, ValueError):
    """A text is neither a path nor the name of a bus; the message says what to write."""


def path_to_listen(channel: str) -> Path:
    """Return the path at which a hub serves the bus `channel`; if `channel` is a name, create the path's folder.

    Raises RuntimeFolderError if the folder cannot be created or another user could write into it, and
    BusNameError if `channel` is neither a path nor a name.
    """
    return _path(channel, owned_folder)


def path_to_call(channel: str) -> Path:
    """Return the path at which clients find the bus `channel`.

    Raises RuntimeFolderError if `channel` is a name and another user could write into the folder for it, and
    BusNameError if `channel` is neither a path nor a name.
    """
    return _path(channel, trusted_folder)


def _path(channel: str, safe_folder: Callable[[Path], Path]) -> Path:
    """Return the path of the bus `channel`; `safe_folder` checks the folder in which a bus with a name is."""
    if _is_path(channel):
        return Path(channel)
    try:
        folder = safe_folder(runtime_folder())
    except RuntimeFolderError as error:
        raise RuntimeFolderError(f"{error}: name the bus by a path, such as ./{channel}.sock") from error
    return folder / f"{_checked(channel)}{_SUFFIX}"


def _checked(name: str) -> str:
    if _NAME.fullmatch(name) is None:
        allowed = "write letters, digits, '_', '-' and '.', at most 32, or a path with a slash"
        raise BusNameError(f"'{name}' is no name of a bus; {allowed}")
    return name


def how_to_start(channel: str) -> str:
    """Return a line of text with the command that starts a hub for the bus `channel`.

    If `channel` is a name, the line also lists the other buses that were started by name.
    """
    remedy = f"start one with: heronry softbus {channel}"
    others = [] if _is_path(channel) else [name for name in _names() if name != channel]
    return f"{remedy}   (there is: {', '.join(others)})" if others else remedy


def _names() -> list[str]:
    try:
        return sorted(file.stem for file in trusted_folder(runtime_folder()).glob(f"*{_SUFFIX}"))
    except RuntimeFolderError:
        return []


def _is_path(channel: str) -> bool:
    return "/" in channel
