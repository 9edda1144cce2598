"""Drivers whose hardware are files: every write is told with its time, and a file `order` tells what is to go wrong."""

import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, NamedTuple

from heronry_agent.device_driver import Option, SensorDriver, Setup
from heronry_agent.drivers.sysfs_number import SysfsOutput

_FOLDER = Option("Folder with the files that stand for the hardware.", str)
FLOODS_S, SLOW_S = 0.3, 0.2
SLUGGISH = "sluggish"  # an order that stays: every transfer takes SLOW_S


class Written(NamedTuple):
    """One write to an actuator."""

    at_ns: int  # immediately before it
    process: int
    value: str


def writes_of(folder: Path) -> list[Written]:
    """Return all writes to the actuator in a folder."""
    file = folder / "writes"
    lines = file.read_text().splitlines() if file.exists() else []
    return [Written(int(at), int(process), value) for at, process, value in map(str.split, lines)]


def register_of(folder: Path) -> str:
    """Return what the actuator's register holds."""
    return (folder / "register").read_text()


class RecordedOutput(SysfsOutput):
    """The shipped driver of a file of the kernel, which also tells each write."""

    OPTIONS: ClassVar = {"folder": _FOLDER}
    LONGEST_COMMAND_MS: ClassVar = 500

    def __init__(self, setup: Setup) -> None:
        self._folder = Path(setup.options["folder"])
        register = str(self._folder / "register")
        super().__init__(Setup(setup.device, {"file": register, "scale": 1.0, "offset": 0.0}, setup.period_ns))
        _tell(self._folder, "opened")

    def command(self, value: float) -> float:
        """Tell the write, and write."""
        _strike(self._folder)
        _append(self._folder / "writes", f"{time.monotonic_ns()} {os.getpid()} {round(value)}\n")
        return super().command(value)


class StruckSensor(SensorDriver):
    """Reads the number 1, or what is ordered."""

    OPTIONS: ClassVar = {"folder": _FOLDER}
    SETTLES_MS: ClassVar = 1_000
    LONGEST_READ_MS: ClassVar = 500

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._folder = Path(setup.options["folder"])
        self._reads = 0
        _tell(self._folder, "opened")

    def read(self) -> float | None:
        """Read, unless something is ordered."""
        instead = _strike(self._folder)
        _append(self._folder / "reads", ".")
        return 1.0 if instead == "" else instead  # type: ignore[return-value] # that is the strike


def _tell(folder: Path, what: str) -> None:
    _append(folder / what, f"{os.getpid()}\n")


def _append(file: Path, text: str) -> None:
    with file.open("a") as one:
        one.write(text)


def _strike(folder: Path) -> object:
    """Do what is ordered; returns what is read instead, or the empty text if nothing is."""
    file = folder / "order"
    try:
        order = file.read_text()
    except FileNotFoundError:
        return ""
    if order in _ONCE:
        file.unlink()
        _ONCE[order]()
        return ""
    if order == SLUGGISH:
        time.sleep(SLOW_S)
    return _INSTEAD.get(order, "")


def _flood() -> None:
    end_s = time.monotonic() + FLOODS_S
    while time.monotonic() < end_s:
        print("x" * 500)


def _fail() -> None:
    raise OSError(121, "Remote I/O error")


_ONCE: dict[str, Callable[[], object]] = {
    "exit": lambda: os._exit(9),
    "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "raise": _fail,
    "hang": lambda: time.sleep(60),
    "slow": lambda: time.sleep(SLOW_S),
    "flood": _flood,
}
_INSTEAD: dict[str, object] = {"nan": math.nan, "far": 1e6, "garbage": [1, 2], "nothing": None}
