"""Modules that harm their partition, each in one way and in its third step."""

# ruff: noqa: ARG002 - none of them looks at anything

import ctypes
import mmap
import os
import sys
import time
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value

THIRD = 3


class Misbehaving(Module):
    """Counts its steps, and misbehaves in the third."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        self._steps += 1
        if self._steps == THIRD:
            self.misbehave()
        return {"demand": float(self._steps)}

    def misbehave(self) -> None:
        """Nothing: this one is good."""


class Segfaults(Misbehaving):
    def misbehave(self) -> None:
        ctypes.string_at(0)


class Exits(Misbehaving):
    def misbehave(self) -> None:
        os._exit(3)


class Leaves(Misbehaving):
    def misbehave(self) -> None:
        sys.exit("that is all")


class Spins(Misbehaving):
    def misbehave(self) -> None:
        while True:
            pass


class Sleeps(Misbehaving):
    def misbehave(self) -> None:
        time.sleep(1e6)


class Stops(Misbehaving):
    def misbehave(self) -> None:
        os.kill(os.getpid(), 19)


class Eats(Misbehaving):
    def misbehave(self) -> None:
        bytearray(64 * 1024 * 1024)


class Shares(Misbehaving):
    """Takes memory that RLIMIT_DATA does not count."""

    def misbehave(self) -> None:
        shared = mmap.mmap(-1, 64 * 1024 * 1024)
        for page in range(0, len(shared), mmap.PAGESIZE):
            shared[page] = 1


class WritesMuch(Misbehaving):
    """Writes 40 MB past Python's own streams, with sequences that would control a terminal."""

    def misbehave(self) -> None:
        for _ in range(40):
            os.write(1, b"\x1b[2J and so on\n" * 65_536)


class PrintsMuch(Misbehaving):
    def misbehave(self) -> None:
        for _ in range(50_000):
            print("\x1b[2J and so on")


class Multiplies(Misbehaving):
    """Ends, and leaves a child behind that would live on."""

    def misbehave(self) -> None:
        os.posix_spawn("/bin/sleep", ["sleep", "1000"], {})
        os._exit(3)


class Forks(Misbehaving):
    """Has a child that is a copy of the partition."""

    def misbehave(self) -> None:
        if os.fork() == 0:
            time.sleep(1e6)


class Floods(Misbehaving):
    def misbehave(self) -> None:
        while True:
            os.write(3, b"listen to me")


class HangsUp(Misbehaving):
    def misbehave(self) -> None:
        os.close(3)
        time.sleep(1e6)


class Shouts(Misbehaving):
    def misbehave(self) -> None:
        for number in range(5_000):
            self.ctx.report_failed("device:left", number)


class Warm(Module):
    """Goes on in another mode with what it has counted."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        self._steps += 1
        return {"demand": float(self._steps)}

    def mode_changed(self) -> bool:
        return True
