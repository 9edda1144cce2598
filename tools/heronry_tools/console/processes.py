"""Worker processes that simulate or plan for a command; if the command is interrupted, all processes end at once.

Only the command's own process handles Ctrl-C, SIGTERM and SIGHUP, although a terminal sends Ctrl-C to the workers as
well. The command's process blocks these signals while it starts a worker, and the worker inherits the blocked signals.
So a worker receives none of them, from its first instruction on. A handler in the worker would be installed too late,
since the imports before it take seconds.

If the command is interrupted, its process kills the workers. This is safe, since a worker stores nothing. If the
command's process is gone, the workers end by themselves.

Each worker is a new Python process (spawn), since a process with the threads of a solver must not be forked.
"""

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, connection, get_context, parent_process
from threading import Thread
from typing import TypeVar

from heronry_tools.console.errors import UserError
from heronry_wire.interruption import NUMBERS

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def processes(jobs: int, begin: Callable[[T], None], beginning: T) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of `jobs` worker processes, each of which calls `begin(beginning)` first.

    The pool starts the workers when it gets its first task. So the caller must submit this task inside
    `held_back`; then the workers inherit the blocked signals.

    Raises UserError if a worker has ended or was killed.
    """
    others = {child.pid for child in active_children()}
    try:
        with ProcessPoolExecutor(jobs, get_context("spawn"), _begin, (begin, beginning)) as executor:
            try:
                yield executor
                executor.shutdown(cancel_futures=True)  # results that are no longer needed
            except BaseException:
                _kill_all_but(others)
                raise
    except BrokenProcessPool:
        raise UserError("a worker process of this command has ended or was killed; repeat the command") from None


@contextmanager
def held_back() -> Iterator[None]:
    """Block, within the `with` block, the signals that end a command.

    Processes that are started within the block inherit this. If signals have come, the first one is raised in this
    process after the block.
    """
    came: list[int] = []
    handlers = {number: signal.signal(number, lambda number, _: came.append(number)) for number in NUMBERS}
    # Started processes inherit this mask. The handlers are needed besides: a thread of a library may receive a signal.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def in_order(tasks: deque[Future[R]]) -> Iterator[R]:
    """Yield the results of tasks of worker processes, in the order of `tasks`; a yielded result is not kept.

    Unlike `Executor.map`, this function cancels no task. `Executor.map` cancels the remaining tasks when its caller
    stops; if the workers are killed as well, the executor's thread ends with a traceback about a cancelled task (Python
    3.11).
    """
    while tasks:
        yield tasks.popleft().result()


def _kill_all_but(others: set[int | None]) -> None:
    for child in active_children():
        if child.pid not in others:
            child.kill()


def _begin(begin: Callable[[T], None], beginning: T) -> None:
    Thread(target=_end_with_parent, daemon=True).start()
    begin(beginning)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)
