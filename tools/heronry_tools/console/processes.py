"""Processes that fly or plan for this one, and how they end: all of them, at once and without a word.

Whoever wants an end tells this process: Ctrl-C, which a terminal says to all of them, or SIGTERM. Processes of ours
take neither, from their first instruction on: signals are held back while they are started, and who is started then
holds them back too. (A handler would come too late: there are seconds of imports before it.) They are killed, since
they keep nothing that would have to be put in order, and end by themselves when this process is gone. They start afresh
(spawn), since a solver that has threads must not be forked.
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
    """Give so many processes, each of which begins so; raises UserError where one of them has died.

    What is given to them first, which starts them, is given while signals are `held_back`.
    """
    others = {child.pid for child in active_children()}
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        with ProcessPoolExecutor(jobs, get_context("spawn"), _begin, (begin, beginning)) as executor:
            try:
                yield executor
                executor.shutdown(cancel_futures=True)  # what nobody wants to know any more
            except BaseException:
                _kill_all_but(others)
                raise
    except BrokenProcessPool:
        raise UserError("a process of this command has ended, or was ended; give the same command again") from None
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def held_back() -> Iterator[None]:
    """Hold back the signals that want an end, from whoever is started too; one that came is taken afterwards."""
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


def in_order(asked: deque[Future[R]]) -> Iterator[R]:
    """Give the results of what was given to processes, in this order, and keep none of them.

    As `Executor.map` does, but what nobody waits for any more is not cancelled: where processes are killed as well, the
    executor's thread ends with a traceback, since it cannot say so of what is cancelled (Python 3.11).
    """
    while asked:
        yield asked.popleft().result()


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
