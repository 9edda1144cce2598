"""Runs one command on this kernel; the CAN interfaces that it needs exist already, or are made for it.

`interfaces_up` makes the interfaces that are missing, and removes them after the command. Interfaces that existed stay
as they were. If one of these is down, CannotRunError is raised. Making an interface needs root and the kernel's vcan
module. If one of these two is missing, UnavailableError is raised, and nothing is left behind.
"""

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from heronry_tools.runtime.vcan.command import Command, ExpiredError
from heronry_tools.runtime.vcan.errors import CannotRunError

IFF_UP = 0x1  # netdevice(7)
POLL_S = 0.02
GRACE_S = 5.0  # time that a command has to end after SIGTERM, before SIGKILL


class UnavailableError(Exception):
    """An interface is missing on this kernel, and this program cannot make it."""


@contextmanager
def interfaces_up(names: list[str]) -> Iterator[None]:
    """Make the missing ones of the interfaces `names`, and remove them after the block.

    Raises UnavailableError if an interface cannot be made, and CannotRunError if an existing one is down.
    """
    with ExitStack() as made:
        for name in names:
            flags = Path("/sys/class/net", name, "flags")
            if not flags.exists():
                _make(name)
                made.callback(_ip, "link", "delete", name)
                if not _ip("link", "set", name, "up"):
                    raise UnavailableError(name)
            elif not int(flags.read_text(), 16) & IFF_UP:
                raise CannotRunError(f"{name} exists but is down: raise it (as root: ip link set {name} up)")
        yield


def _make(name: str) -> None:
    if not _ip("link", "add", name, "type", "vcan"):
        raise UnavailableError(name)


def _ip(*words: str) -> bool:
    """Run ip(8); tell whether it succeeded."""
    try:
        done = subprocess.run(["ip", *words], stdin=subprocess.DEVNULL, capture_output=True, check=False)
    except FileNotFoundError:
        return False
    return done.returncode == 0


def run(command: Command, expired: Callable[[], bool]) -> int:
    """Run `command`; returns its exit code, or 128 + n if signal n ended it.

    If a signal handler raises an exception, the command is ended, and the exception passes on.

    expired: tells whether the time of the command is over; if so, the command is ended.
    Raises CannotRunError if the command cannot be started, and ExpiredError if its time is over.
    """
    stdin = None if os.isatty(0) else subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            command.argv, executable=command.executable, env=command.env, cwd=command.cwd, stdin=stdin
        )
    except OSError as error:
        raise CannotRunError(f"cannot run {command.argv[0]}: {error.strerror}") from error
    try:
        while process.poll() is None:
            if expired():
                raise ExpiredError
            time.sleep(POLL_S)
    finally:
        _end(process)
    return process.returncode if process.returncode >= 0 else 128 - process.returncode


def _end(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
