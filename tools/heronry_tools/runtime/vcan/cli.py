"""The command line of tools/with-vcan: parses it, chooses where to run the command, and gives one exit code.

    the command's own   the command has ended by itself
    128 + n             signal n ended the command
    124                 the time ran out
    125                 the command could not be run at all
    126                 the command is no program
    127                 the command was not found

The codes from 124 on are those of timeout(1) and of the shells. When a signal stops this program, the program cleans up
and ends by that signal.
"""

import argparse
import os
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import NoReturn

from heronry_tools.runtime.vcan import debian_packages, host_kernel, user_mode_linux
from heronry_tools.runtime.vcan.command import ExpiredError, NotFoundError, described
from heronry_tools.runtime.vcan.errors import CannotRunError

TIME_RAN_OUT, CANNOT_RUN, NOT_FOUND = 124, 125, 127
STOPPED_BY = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERFACE_NAME = re.compile(r"[A-Za-z0-9_.-]{1,15}")  # IFNAMSIZ is 16 with its closing zero

HELP = """\
Run COMMAND where a SocketCAN interface vcan0 exists.

If this kernel has a vcan0, or can be given one (by root, where the module vcan
exists), the command runs right here, and a vcan0 made for it is removed
afterwards. Otherwise (containers, WSL, most CI runners) it runs inside a
user-mode Linux: a Linux kernel that is an ordinary process, needs no root, and
works on your own files. Its parts come from Debian's packages, fetched once
(about 42 MB) into ~/.cache/heronry/uml. After that it boots in about a second.

Inside and outside are alike: working folder, environment, arguments, user, exit code, stdout, stderr, and on a terminal
what is typed: "tools/with-vcan bash" is a shell. What differs: standard input is empty where it is no terminal,
candump and cansend are always there, and a user-mode Linux has one CPU, 2 GiB of memory, its own processes, /dev, /run
and network (no Internet). It is slow: it shows that something works, not how fast.
"""
EXAMPLES = """\
examples:
  tools/with-vcan bash                                    a shell, on a terminal
  tools/with-vcan candump -n 1 vcan0                      waits for one frame
  tools/with-vcan sh -c 'candump -n1 vcan0 & sleep 1; cansend vcan0 321#C0FFEE; wait'
  tools/with-vcan --interfaces vcan0,vcan1 ip -brief link
  tools/with-vcan --timeout 600 .venv/bin/pytest -m vcan

exit codes:
  the command's own (128+n: ended by signal n); 124: time ran out;
  125, 126, 127: it could not be run, is no program, was not found (stderr says why)
"""


class _Stopped(BaseException):
    """A signal that stops this program has come; not an Exception, so that no handler takes it for a failure."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal_number)
        self.signal_number = signal_number


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"with-vcan: {message}; see tools/with-vcan --help", file=sys.stderr)
        raise SystemExit(CANNOT_RUN)


def _arguments(words: list[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="tools/with-vcan", description=HELP, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--timeout", type=_seconds, metavar="S", help="end the command S seconds after the start of with-vcan"
    )
    parser.add_argument(
        "--interfaces",
        type=_interface_names,
        default=["vcan0"],
        metavar="A,B",
        help="CAN interfaces for COMMAND: those that are missing are made, and removed after it (default: vcan0)",
    )
    parser.add_argument(
        "command", nargs=argparse.REMAINDER, metavar="COMMAND...", help="the command to run, with its arguments"
    )
    arguments = parser.parse_args(words)
    if arguments.command[:1] == ["--"]:
        del arguments.command[0]
    if not arguments.command:
        parser.error("a command to run is missing")
    return arguments


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above zero")
    return seconds


def _interface_names(text: str) -> list[str]:
    names = text.split(",")
    for name in names:
        if not INTERFACE_NAME.fullmatch(name) or names.count(name) > 1:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a list of different interface names, such as vcan0,vcan1"
            )
    return names


def _can_utils() -> Path | None:
    """Return the folder with candump and cansend, fetched if needed; None if they are installed."""
    if shutil.which("candump") and shutil.which("cansend"):
        return None
    return debian_packages.unpacked("can-utils") / "usr" / "bin"


def _can_utils_if_to_be_had() -> Path | None:
    """Fetch candump and cansend if they are not installed, and give the folder into which they were fetched.

    None: they are installed, or cannot be fetched. If they cannot be fetched, a message says so, and the command of the
    user runs without them, since it may not need them.
    """
    try:
        return _can_utils()
    except CannotRunError as error:
        print(f"with-vcan: going on without candump and cansend: {error}", file=sys.stderr, flush=True)
        return None


def _run(argv: list[str], interfaces: list[str], expired: Callable[[], bool]) -> int:
    try:
        with host_kernel.interfaces_up(interfaces):
            return host_kernel.run(described(argv, _can_utils_if_to_be_had()), expired)
    except host_kernel.UnavailableError:
        return user_mode_linux.run(described(argv, _can_utils()), interfaces, expired)


def _stop(signal_number: int, _frame: FrameType | None) -> None:
    for number in STOPPED_BY:
        signal.signal(number, _stop_already)
    raise _Stopped(signal_number)


def _stop_already(_signal_number: int, _frame: FrameType | None) -> None:
    """Ignore a further signal, so that the clean-up is not interrupted."""


def _die_of(signal_number: int) -> NoReturn:
    signal.signal(signal_number, signal.SIG_DFL)
    os.kill(os.getpid(), signal_number)
    raise SystemExit(128 + signal_number)  # not reached, unless the signal is blocked


def main(words: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = _arguments(sys.argv[1:] if words is None else words)
    deadline_s = time.monotonic() + arguments.timeout if arguments.timeout else float("inf")
    for number in STOPPED_BY:
        signal.signal(number, _stop)
    try:
        return _run(arguments.command, arguments.interfaces, lambda: time.monotonic() >= deadline_s)
    except ExpiredError:
        return _give_up(TIME_RAN_OUT, f"{arguments.command[0]} was ended after {arguments.timeout:g} s (--timeout)")
    except NotFoundError as error:
        return _give_up(NOT_FOUND, str(error))
    except CannotRunError as error:
        return _give_up(CANNOT_RUN, str(error))
    except BrokenPipeError:
        _die_of(signal.SIGPIPE)
    except _Stopped as stopped:
        _die_of(stopped.signal_number)


def _give_up(exit_code: int, sentence: str) -> int:
    print(f"with-vcan: {sentence}", file=sys.stderr)
    return exit_code
