"""Worker processes that simulate or plan for this one; they end together, immediately and without output.

Ctrl-C, which a terminal sends to all of them, and SIGTERM are for this process. The workers take neither signal, from
their first instruction on: this process blocks the signals while it starts a worker, and the worker inherits that mask.
(A handler would come too late: seconds of imports precede it.) The workers are killed, since they keep nothing that
must be cleaned up, and they end by themselves when this process is gone. They start afresh (spawn), since a solver that
has threads must not be forked.
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
from types import FrameType
from typing import NoReturn, TypeVar

from heronry_tools.console.errors import UserError

T = TypeVar("T")
R = TypeVar("R")

_ENDS = (signal.SIGINT, signal.SIGTERM)
_TERMINATED = 128 + signal.SIGTERM


@contextmanager
def processes(jobs: int, begin: Callable[[T], None], beginning: T) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of `jobs` processes, each of which calls `begin(beginning)` first; raises UserError where one dies.

    The first task, which starts the workers, is submitted while signals are `held_back`.
    """
    others = {child.pid for child in active_children()}
    before = signal.signal(signal.SIGTERM, _terminate)
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
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def held_back() -> Iterator[None]:
    """Block SIGINT and SIGTERM, also in processes started meanwhile; pending signals are delivered afterwards."""
    came: list[int] = []
    handlers = {number: signal.signal(number, lambda number, _: came.append(number)) for number in _ENDS}
    # This mask is inherited; a thread of a library may take a signal all the same.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def in_order(tasks: deque[Future[R]]) -> Iterator[R]:
    """Yield the results of tasks given to worker processes, in this order, and keep none of them.

    Like `Executor.map`, but results that are no longer needed are not cancelled: where the workers are killed as well,
    the executor's thread would end with a traceback on a cancelled task (Python 3.11).
    """
    while tasks:
        yield tasks.popleft().result()


def _terminate(_number: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(_TERMINATED)


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
