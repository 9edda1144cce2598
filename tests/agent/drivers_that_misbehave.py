"""Drivers for tests: files stand for hardware, and a file `order` tells what is to go wrong."""

import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from heronry_agent.device_driver import ActuatorDriver, Measured, Option, SensorDriver, Setup

FOLDER = Option("Folder with the files that stand for hardware.", str)


class _Mishap:
    def __init__(self, folder: Path) -> None:
        self._file = folder / "order"

    def happen(self) -> object:
        """Do what the file orders; returns a value that takes the place of the reading."""
        try:
            order = self._file.read_text()
        except FileNotFoundError:
            return None
        deed = _DEEDS.get(order)
        return deed() if deed is not None else _INSTEAD.get(order)


def _fail() -> None:
    raise OSError(121, "Remote I/O error")


_DEEDS: dict[str, Callable[[], object]] = {
    "exit": lambda: os._exit(9),
    "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "raise": _fail,
    "hang": lambda: time.sleep(60),
    "old": lambda: Measured(1.0, time.monotonic_ns() - 10**10),
    "future": lambda: Measured(1.0, time.monotonic_ns() + 10**10),
}
_INSTEAD: dict[str, object] = {
    "nan": math.nan,
    "infinite": math.inf,
    "far": 1e6,
    "no value": [1, 2],
    "nothing": "nothing",
    "open slowly": "open slowly",
}


class FileSensor(SensorDriver):
    """Reads a number from the file `reading`."""

    OPTIONS: ClassVar = {"folder": FOLDER}
    SETTLES_MS: ClassVar = 300
    LONGEST_READ_MS: ClassVar = 500

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._folder = Path(setup.options["folder"])
        self._mishap = _Mishap(self._folder)

    def read(self):
        instead = self._mishap.happen()
        if instead == "nothing":
            return None
        return float((self._folder / "reading").read_text()) if instead is None else instead


class FloodingSensor(FileSensor):
    """Reads as often as it may, prints each time, and writes to descriptors that are not its own."""

    WAITS: ClassVar = True

    def read(self):
        print("x" * 500)
        return super().read()


class SlowSensor(FileSensor):
    """Does not get open while the order is "open slowly"."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        while self._mishap.happen() == "open slowly":
            time.sleep(0.002)


class FileServo(ActuatorDriver):
    """Writes its position to the file `register`, and every write with its time to `writes`.

    While the order is "open slowly", it does not get open, and names its process in the file `opening`.
    """

    OPTIONS: ClassVar = {"folder": FOLDER, "longest_ms": Option("Longest time on.", int, 0)}
    LONGEST_COMMAND_MS: ClassVar = 500

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._folder = Path(setup.options["folder"])
        self._mishap = _Mishap(self._folder)
        while self._mishap.happen() == "open slowly":
            (self._folder / "opening").write_text(str(os.getpid()))
            time.sleep(0.002)

    def command(self, value: float) -> float:
        self._mishap.happen()
        self._write(str(value))
        return value

    def lasts_ms(self, value: float) -> float | None:
        longest_ms = self.setup.options["longest_ms"]
        return longest_ms if longest_ms and value else None

    def release(self) -> None:
        self._write("released")

    def _write(self, what: str) -> None:
        with (self._folder / "writes").open("a") as writes:
            writes.write(f"{time.monotonic_ns()} {what}\n")
        (self._folder / "register").write_text(what)
