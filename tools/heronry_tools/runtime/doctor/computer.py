"""The check of this computer: its Python and packages, and whether its kernel supports CAN."""

import platform
import socket
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from heronry_tools.runtime.doctor.finding import Finding

_NEEDED = ("heronry", "python-can")
_WELCOME = ("canopen",)  # an extra


def assess_computer(*, needs_can: bool) -> Iterator[Finding]:
    """Findings about software; `needs_can`: whether the bus to be used is SocketCAN."""
    found = {name: _version(name) for name in (*_NEEDED, *_WELCOME)}
    told = ", ".join(f"{name} {number}" for name, number in found.items() if number is not None)
    missing = [name for name in _NEEDED if found[name] is None]
    remedy = f"pip install {' '.join(missing)}" if missing else None
    yield Finding("versions", f"Python {platform.python_version()}, {told or 'no package'}", remedy)
    if needs_can and not knows_can():
        remedy = "modprobe can-raw   (or use a software bus: -i softbus, or tools/with-vcan)"
        yield Finding("kernel", "this kernel does not support CAN", remedy)


def knows_can() -> bool:
    """Tell whether a CAN socket can be made."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
