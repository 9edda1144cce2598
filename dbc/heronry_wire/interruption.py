"""Ends a command that a signal interrupts: SIGINT (Ctrl-C), SIGTERM, or SIGHUP (the command's terminal has closed).

A command passes through these states. A function of this file, or a signal, leads from one state to the next:

    unguarded --begin()--> loading --running()--> running --finished()--> finished
                              |                      |                       |
                            signal                 signal                  signal
                              v                      v                       v
                          ended at once      interrupted --0.3 s--> ended    ignored

- *Unguarded*: the first milliseconds of Python itself. A signal has Python's usual effect.
- *Loading*: nothing has been done, so nothing is to be cleaned up. The handler of the signal ends the process at once.
  It raises no exception, because code that runs during an import may swallow an exception, or turn it into an
  ImportError.
- *Running*: the handler raises `Interrupted` in the main thread, so that `with` blocks clean up. Since the exception
  may have no effect, a second thread ends the process if the process still runs `_PATIENCE_S` after the signal.
- *Interrupted*: no output of the command counts as a result any more. `expect_none`, which is called before a file is
  written, raises `Interrupted` once more. A second signal ends the process at once.

The exit code is 128 + the number of the signal: 130 for SIGINT, 143 for SIGTERM, 129 for SIGHUP.

*Why `Interrupted` may have no effect.* Python raises an exception only between two instructions, but native code is one
long instruction: CP-SAT searches for seconds. And a callback of the interpreter may swallow the exception.

*The second thread.* Python's own C handler wakes this thread when a signal comes. Before the thread ends the process,
it kills the worker processes of `multiprocessing`. If the clean-up of a command takes longer, the command uses
`in_order`; then the thread does not end the process.

*Other handlers.* A program that serves until it is stopped (the manager, an agent) installs its own handlers for these
signals; then the thread does nothing. A signal that the parent process has ignored (`nohup`) stays ignored.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, NoReturn

NUMBERS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PATIENCE_S: Final = 0.3


class Interrupted(KeyboardInterrupt):
    """Raised in the main thread after a signal has come; the function `came` gives the command's exit code."""


class _State:
    """What is known of the signals of this process.

    came: number of the signal that has come; 0: none has come.
    takes_time: whether the clean-up after a signal may take as long as it needs. If not, the process is ended
        `_PATIENCE_S` after the signal.
    """

    came = 0
    takes_time = False


def noted() -> list[int]:
    """From now on append each SIGINT and SIGTERM to the returned list when it comes; the signals do nothing else.

    For a program that serves until a signal comes.
    """
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return came


def begin() -> None:
    """Let a signal end the process at once from now on; for a process that has nothing to clean up yet."""
    _open_standard_streams()
    _handle(_end_at_once)


def running() -> None:
    """Let a signal raise `Interrupted` from now on; a thread ends the process if the exception has no effect."""
    if not _handle(_interrupt):
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True, name="interruption").start()
    sys.unraisablehook = _report_unraisable


def finished() -> None:
    """End the process with the signal's exit code if a signal has come; otherwise ignore signals from now on.

    Python's own clean-up of all modules is skipped.
    """
    if _State.came:
        _end(_State.came)
    _handle(signal.SIG_IGN)


def came() -> int:
    """Return the exit code of the signal that has interrupted this process; 0 where no signal has come."""
    return 128 + _State.came if _State.came else 0


def expect_none() -> None:
    """Raise `Interrupted` if a signal has come.

    To be called before a result is written, since the signal may have spoilt the result.
    """
    if _State.came:
        raise Interrupted


@contextmanager
def in_order() -> Iterator[None]:
    """Within this context the first signal raises `Interrupted`, and the clean-up may take as long as it needs.

    A second signal ends the process immediately.
    """
    _State.takes_time = True
    try:
        yield
    finally:
        _State.takes_time = False


def _handle(handler: Callable[[int, FrameType | None], NoReturn] | signal.Handlers) -> bool:
    """Install a handler for each signal that is neither ignored nor handled by other code.

    Tells whether there was such a signal.
    """
    ours = (signal.SIG_DFL, signal.default_int_handler, _end_at_once, _interrupt)
    numbers = [number for number in NUMBERS if signal.getsignal(number) in ours]
    for number in numbers:
        signal.signal(number, handler)
    return bool(numbers)


def _end_at_once(number: int, _frame: FrameType | None) -> NoReturn:
    _end(number)


def _interrupt(number: int, _frame: FrameType | None) -> NoReturn:
    if _State.came:
        _end(number)
    _State.came = number
    raise Interrupted


def _watch(reader: int) -> None:
    """Wait for signals on `reader`, a pipe into which Python writes one byte per signal; runs in the second thread."""
    while True:
        number = os.read(reader, 1)[0]
        if number not in NUMBERS or signal.getsignal(number) is not _interrupt:
            continue
        threading.Event().wait(_PATIENCE_S)
        if not _State.takes_time:
            _end(number)


def _end(number: int) -> NoReturn:
    active_children = getattr(sys.modules.get("multiprocessing"), "active_children", None)
    if active_children is not None:  # else it is not imported, or only in part: there are no children yet
        for child in active_children():
            child.kill()
    os._exit(128 + number)


def _report_unraisable(unraisable: "sys.UnraisableHookArgs", /) -> None:
    """Report an exception that the interpreter has swallowed, as Python does, but no `Interrupted`."""
    # after that one the second thread (see head) ends the process
    if not isinstance(unraisable.exc_value, Interrupted):
        sys.__unraisablehook__(unraisable)


def _open_standard_streams() -> None:
    """Open the standard streams that were closed when this process started (`>&-` in a shell).

    If a stream stayed closed, the next file that is opened would get the number of the stream. Of the streams opened
    here, standard input is empty, a write to standard output is an error, and what is written to standard error is
    lost.
    """
    for number, flags in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, flags)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, closefd=False, encoding="utf-8")
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", closefd=False, encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", closefd=False, encoding="utf-8")
