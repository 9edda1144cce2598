"""Runs the hub of `heronry softbus` until Ctrl-C or SIGTERM comes.

With `until_eof` the hub also stops when standard input ends.
"""

import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager

from heronry_tools.runtime.softbus.hub import Hub
from heronry_tools.runtime.softbus.place import path_to_listen
from heronry_wire.clock_of_day import time_of_day


def serve(channel: str, bitrate: int, *, until_eof: bool) -> int:
    """Serve a bus at a path or under a name; returns 0.

    Raises HubError or RuntimeFolderError where that is not possible.
    """
    with closing(Hub(path_to_listen(channel), bitrate)) as hub, _woken_by_signals() as woken:
        print(f"{time_of_day()} {channel}: {bitrate} bit/s; use this bus with -i softbus -c {channel}", flush=True)
        hub.run([woken, sys.stdin.fileno()] if until_eof else [woken])
    return 0


@contextmanager
def _woken_by_signals() -> Iterator[int]:
    """Yield a descriptor that becomes readable when Ctrl-C or SIGTERM comes."""
    woken, wake = socket.socketpair()
    with woken, wake:
        woken.setblocking(False)
        wake.setblocking(False)
        before_fd = signal.set_wakeup_fd(wake.fileno())
        handlers = {number: signal.signal(number, lambda *_: None) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield woken.fileno()
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
            signal.set_wakeup_fd(before_fd)
