"""The check of this computer: its Python and packages, its kernel's support for CAN, how late it wakes a process."""

import platform
import socket
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from heronry_tools.runtime.doctor.finding import Finding
from heronry_tools.runtime.wake_ups import kept_heartbeat_ns

_NEEDED = ("heronry", "python-can")
_WELCOME = ("canopen",)  # an extra
_NS_PER_MS = 1_000_000


def assess_computer(*, needs_can: bool) -> Iterator[Finding]:
    """Give the findings about this computer's Python, its packages, and its kernel's support for CAN.

    needs_can: whether the bus to be used is SocketCAN; if not, the kernel is not checked.
    """
    found = {name: _version(name) for name in (*_NEEDED, *_WELCOME)}
    told = ", ".join(f"{name} {number}" for name, number in found.items() if number is not None)
    missing = [name for name in _NEEDED if found[name] is None]
    remedy = f"pip install {' '.join(missing)}" if missing else None
    yield Finding("versions", f"Python {platform.python_version()}, {told or 'no package'}", remedy)
    if needs_can and not knows_can():
        remedy = "modprobe can-raw   (or use a software bus: -i softbus, or tools/with-vcan)"
        yield Finding("kernel", "this kernel does not support CAN", remedy)


def assess_wake_ups(late_ns: int, heartbeat_ns: int) -> Finding:
    """Give the finding about how late a node runs on this computer.

    late_ns: largest lateness in a rehearsal (`wake_ups`). heartbeat_ns: heartbeat period of the bus.
    """
    late = f"under the present load a node runs up to {late_ns / _NS_PER_MS:.1f} ms late here"
    if late_ns <= heartbeat_ns:
        return Finding("wake-ups", f"{late}: it can keep a heartbeat of {heartbeat_ns / _NS_PER_MS:g} ms")
    says = f"{late}: it may miss a heartbeat of {heartbeat_ns / _NS_PER_MS:g} ms, and be called lost"
    period = f"heartbeat_ms: {kept_heartbeat_ns(late_ns) / _NS_PER_MS:g}"
    return Finding("wake-ups", says, f"top   (shows what else runs here; or write {period} for that bus into the spec)")


def knows_can() -> bool:
    """Tell whether this kernel supports CAN sockets."""
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
