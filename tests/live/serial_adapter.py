"""A CAN adapter on a serial line, whose firmware is the test: Linux makes a CAN interface with a controller of it.

Its slcan driver does so with any terminal; here that is a pseudo-terminal. So bit rate, controller
states, bus-off and a transmit queue that fills are the kernel's own, and the test decides what happens on the wire. The
lines are those of the LAWICEL CAN232 manual, with the state lines that Linux added (drivers/net/can/slcan): `t` a
frame of 11 bits, `s` the state, `C`, `S`, `O` close, set the bit rate, open.
"""

import fcntl
import os
import struct
import subprocess
import threading
import time
import tty
from pathlib import Path
from types import TracebackType
from typing import Self

from heronry_tools.runtime.vcan import debian_packages

_INTERFACES = Path("/sys/class/net")
_PATIENCE_S = 30.0
_N_SLCAN, _TIOCSETD = 17, 0x5423  # tty(4): the line discipline


class NoAdapterError(Exception):
    """This kernel has no slcan driver, or this user may not use it."""


class SerialAdapter:
    """An adapter that acknowledges every frame; `name` is its interface. It reads while it is not `stalled`."""

    def __init__(self) -> None:
        before = set(_INTERFACES.iterdir())
        self._load_driver()
        self._line, self._kernel_end = os.openpty()
        tty.setraw(self._line)
        tty.setraw(self._kernel_end)
        try:
            fcntl.ioctl(self._kernel_end, _TIOCSETD, struct.pack("i", _N_SLCAN))
        except OSError as error:
            raise NoAdapterError(str(error)) from error
        (interface,) = set(_INTERFACES.iterdir()) - before
        self.name = interface.name
        self._may_read = threading.Event()
        self._may_read.set()
        threading.Thread(target=self._read, daemon=True).start()

    def set_up(self, bitrate: int) -> None:
        """Bring the interface up, or down and up again, at a bit rate."""
        self.ip("down")
        self.ip("type", "can", "bitrate", str(bitrate))
        self.ip("up")

    def ip(self, *words: str) -> None:
        subprocess.run(["ip", "link", "set", self.name, *words], check=True)

    def reports(self, line: bytes) -> None:
        """The firmware writes a line."""
        os.write(self._line, line + b"\r")

    def stall(self) -> None:
        """The line takes nothing any more."""
        self._may_read.clear()

    def go_on(self) -> None:
        """The line takes everything again."""
        self._may_read.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._may_read.set()
        os.close(self._kernel_end)
        os.close(self._line)
        until_s = time.monotonic() + _PATIENCE_S
        while (_INTERFACES / self.name).exists() and time.monotonic() < until_s:  # the next one gets its name
            time.sleep(0.05)

    @staticmethod
    def _load_driver() -> None:
        folder = debian_packages.unpacked("user-mode-linux")
        busybox = debian_packages.unpacked("busybox-static") / "bin" / "busybox"
        if Path("/sys/module/slcan").exists():
            return
        for module in folder.glob(f"usr/lib/uml/modules/{os.uname().release}/kernel/drivers/net/can/slcan/slcan.ko*"):
            if subprocess.run([busybox, "insmod", module], check=False).returncode == 0:
                return
        raise NoAdapterError("its module cannot be loaded")

    def _read(self) -> None:
        while self._may_read.wait():
            try:
                if not os.read(self._line, 4096):
                    return
            except OSError:  # closed
                return
