"""The check of this computer: its Python and packages, its kernel, its date, its disk, how late it wakes a process."""

import os
import platform
import socket
import time
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.wake_ups import kept_heartbeat_ns

_NEEDED = ("heronry", "python-can")
_WELCOME = ("canopen",)  # an extra
_NS_PER_MS = 1_000_000
_DATE_MARGIN_S = 60.0  # clocks of two computers that share files differ by less
_LEAST_ROOM_BYTES = 16 * 1024 * 1024  # a journal takes less than 1 MB, and other programs write to the same disk


def assess_computer(*, needs_can: bool) -> Iterator[Finding]:
    """Yield the findings about this computer's Python, its packages, and its kernel's support for CAN.

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
    """Return the finding about how late a node runs on this computer.

    late_ns: largest lateness in a rehearsal (`wake_ups`). heartbeat_ns: heartbeat period of the bus.
    """
    late = f"under the present load a node runs up to {late_ns / _NS_PER_MS:.1f} ms late here"
    if late_ns <= heartbeat_ns:
        return Finding("wake-ups", f"{late}: it can keep a heartbeat of {heartbeat_ns / _NS_PER_MS:g} ms")
    says = f"{late}: it may miss a heartbeat of {heartbeat_ns / _NS_PER_MS:g} ms, and be called lost"
    period = f"heartbeat_ms: {kept_heartbeat_ns(late_ns) / _NS_PER_MS:g}"
    return Finding("wake-ups", says, f"top   (shows what else runs here; or write {period} for that bus into the spec)")


def assess_date(now_s: float, files: Iterable[Path]) -> Finding:
    """Return the finding about the date: files that are here already were not written in the future.

    A computer without a clock that runs on a battery begins with an old date.

    now_s: the time of this computer's clock, as time.time() gives it.
    """
    for file in files:
        try:
            written_s = file.stat().st_mtime
        except OSError:
            continue
        if written_s > now_s + _DATE_MARGIN_S:
            says = f"it is {_date(now_s)} here, but {file} was written at {_date(written_s)}"
            return Finding("clock", says, "timedatectl set-ntp true   (or set the clock with 'timedatectl set-time')")
    return Finding("clock", f"it is {_date(now_s)} here")


def assess_disk(folder: Path) -> Finding:
    """Return the finding about the disk on which a manager keeps its journal in `folder`."""
    try:
        disk = os.statvfs(folder)
    except OSError as error:
        return Finding("disk", f"{folder}: {error.strerror}", f"mkdir -p {folder}   (and restart the manager)")
    room = disk.f_bavail * disk.f_frsize
    if disk.f_flag & os.ST_RDONLY:
        return Finding("disk", f"the disk of {folder} is read-only", f"mount -o remount,rw {_mount_of(folder)}")
    says = f"the disk of {folder} has {room / 1e6:.0f} MB left"
    return Finding("disk", says, f"du -xh {_mount_of(folder)} | sort -h" if room < _LEAST_ROOM_BYTES else None)


def _mount_of(folder: Path) -> Path:
    return next((one for one in (folder, *folder.parents) if one.is_mount()), folder)


def _date(seconds: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


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
