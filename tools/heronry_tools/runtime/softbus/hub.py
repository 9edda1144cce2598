"""The hub of a software bus: one process with a single `select` loop, no threads and no locks.

The hub decides which clients may connect. It passes the frames that clients offer to the line (`line.py`), and
each frame that has left the line to the clients.

Each round of the loop takes these steps:

1. It notes the time.
2. It sleeps until a record comes, or until the line has to advance.
3. It reads all records that have come.
4. It lets the line advance to the time noted in step 1.

So no offer that was made before the noted time is overlooked. An offer that ends the sleep is newer than the
noted time, so the line does not start it in this round. The next round reads without a sleep. All offers that
were made until then take part in the arbitration.

`select` is used because its time-out counts microseconds; the time-out of `epoll` counts whole milliseconds.

Frames are stamped with CLOCK_MONOTONIC. Clients compute the date of a frame from this stamp and from the system
clock as it stood when the hub started. So if the system clock is set later, neither the date of a frame nor the
interval between two frames changes.

A bus can be made as bad as a radio (`disturb`): bits take longer, and receivers miss frames. Which frames a
receiver misses is drawn for each receiver by itself. The sender does not notice that a frame was missed, since
the frame has left.

Errors:

- A client is slow, stopped or dead: `port.py` handles this.
- A client breaks the protocol: it gets the reason and is removed.
- The hub dies: its clients read the end of both sockets. After a restart of the hub the clients connect anew;
  the hub stores nothing.
- Two hubs are started with one path: `address.py` handles this.
- The process that started the hub dies, even by SIGKILL: `starter.py` handles this.
"""

import ctypes
import os
import select
import time
from collections.abc import Iterable
from pathlib import Path
from random import Random
from typing import Any

from heronry_tools.runtime.softbus.address import Address
from heronry_tools.runtime.softbus.line import NS_PER_S, Line, Transmission
from heronry_tools.runtime.softbus.port import Port
from heronry_tools.runtime.softbus.protocol import (
    PROTOCOL_VERSION,
    BusStatistics,
    decode_command,
    decode_filters,
    decode_frame,
    encode_command,
    encode_frame,
    is_command,
)
from heronry_wire.frame import Malformed

MAX_CLIENTS = 400
"""A client takes two descriptors, and `select` takes none above 1023."""

_MAX_CONNECTIONS = (
    MAX_CLIENTS + 100
)  # a client above MAX_CLIENTS is told that the bus is full; connections above this number wait

_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_TIMER_SLACK_NS = 1_000


class Hub:
    """A bus of `bitrate` (bit/s) at the UNIX socket `path`. Raises HubError when the path cannot be used."""

    def __init__(self, path: Path, bitrate: int) -> None:
        self._address = Address(path)
        self._line = Line(bitrate)
        self._ports: list[Port] = []
        self._by_fd: dict[int, Port] = {}
        self._last_number = 0
        self._loss_per_mille = 0
        self._random = Random(0)
        self._looked_ns = time.monotonic_ns()
        self._day_offset_ns = time.time_ns() - self._looked_ns  # only to date frames for people

    def run(self, stop_fds: Iterable[int]) -> None:
        """Serve the bus until one of `stop_fds` becomes readable."""
        _sharpen_timers()
        stops = frozenset(stop_fds)
        listener_fd = self._address.listener.fileno()
        while True:
            noted_ns = time.monotonic_ns()
            watched = [*stops, *self._by_fd]
            if len(self._ports) < _MAX_CONNECTIONS:
                watched.append(listener_fd)
            clogged = [port for port in self._ports if port.queue]
            readable, writable, _ = select.select(watched, clogged, [], self._sleep_s(noted_ns))
            if not stops.isdisjoint(readable):
                return
            for fd in readable:
                if fd == listener_fd:
                    self._connect()
                else:
                    self._serve(self._by_fd[fd])
            for port in writable:
                port.flush()
            self._remove_the_gone()
            while (gone := self._line.advance(noted_ns)) is not None:
                self._hand_over(gone)
            self._looked_ns = noted_ns

    def close(self) -> None:
        """Disconnect every client and remove the socket."""
        self._address.close()
        for port in self._ports:
            port.close()

    def _sleep_s(self, now_ns: int) -> float | None:
        deadline_ns = self._line.next_deadline_ns()
        return None if deadline_ns is None else max(0, deadline_ns - now_ns) / NS_PER_S

    def _connect(self) -> None:
        try:
            command, _ = self._address.listener.accept()
        except OSError:
            return  # the client has gone again
        self._last_number += 1
        port = Port(self._last_number, command)
        self._ports.append(port)
        self._by_fd[command.fileno()] = port

    def _serve(self, port: Port) -> None:
        record, descriptors = port.read()
        if not record:
            return
        if port.receive is None:
            problem = self._welcome(port, record, descriptors)
        elif is_command(record):
            problem = self._accept(port, record)
        else:
            problem = self._take_offer(port, record)
        if problem is not None:
            port.refuse(problem.reason)

    def _welcome(self, port: Port, record: bytes, descriptors: list[int]) -> Malformed | None:
        match decode_command(record), descriptors:
            case {"do": "hello", "protocol": version, "own": bool(own)}, [descriptor]:
                if version != PROTOCOL_VERSION:
                    remedy = "start both with the same version of heronry"
                    problem = f"the bus speaks protocol {PROTOCOL_VERSION} and the client {version!r}; {remedy}"
                elif len(self._ports) > MAX_CLIENTS:
                    problem = f"the bus has {MAX_CLIENTS} clients already, which is its limit; end one of them"
                elif port.join(descriptor, wants_own=own):
                    port.answer(encode_command({"bitrate": self._line.bitrate, "day_offset_ns": self._day_offset_ns}))
                    return None
                else:
                    problem = "what came with the hello is no socket"
            case _:
                problem = "the first record is not a hello with one descriptor"
        for descriptor in descriptors:
            os.close(descriptor)
        return Malformed(problem)

    def _accept(self, port: Port, record: bytes) -> Malformed | None:
        match decode_command(record):
            case {"do": "filters", "filters": None}:
                port.set_filters(None)
                port.answer(encode_command({}))
            case {"do": "filters", "filters": content}:
                filters = decode_filters(content)
                if isinstance(filters, Malformed):
                    return filters
                port.set_filters(filters)
                port.answer(encode_command({}))
            case {"do": "disturb", "slowdown": int(slowdown), "loss": int(loss)} if slowdown > 0 <= loss:
                self._line.slowdown, self._loss_per_mille = slowdown, loss
                port.answer(encode_command({}))
            case {"do": "statistics"}:
                port.answer(encode_command(self._statistics()))
            case _:
                return Malformed("unknown command")
        return None

    def _take_offer(self, port: Port, record: bytes) -> Malformed | None:
        offered = decode_frame(record)
        if isinstance(offered, Malformed):
            return offered
        if port.mailbox_full:
            return Malformed("a frame was offered before the last one had left the bus")
        # The sender's clock is ours; a stamp outside of the time since the last look is not used.
        offered_ns = min(max(offered.time_ns, self._looked_ns), time.monotonic_ns())
        port.mailbox_full = True
        self._line.offer(port.number, offered._replace(time_ns=offered_ns, own=False))
        return None

    def _hand_over(self, gone: Transmission) -> None:
        received = gone.sent._replace(time_ns=gone.end_ns)
        frame = received.frame
        record = encode_frame(received)
        for port in self._ports:
            if port.number == gone.client:
                port.confirm(received)
            elif port.accepts(frame.can_id, extended=frame.extended) and not self._is_missed():
                port.deliver(record)

    def _is_missed(self) -> bool:
        """Decide at random whether a receiver misses a frame, as a receiver of a bad radio does."""
        return self._loss_per_mille > 0 and self._random.randrange(1000) < self._loss_per_mille

    def _remove_the_gone(self) -> None:
        for port in [port for port in self._ports if port.gone]:
            self._ports.remove(port)
            del self._by_fd[port.command.fileno()]
            self._line.withdraw(port.number)
            port.close()

    def _statistics(self) -> dict[str, Any]:
        return BusStatistics(
            bitrate=self._line.bitrate,
            time_ns=time.monotonic_ns(),
            busy_ns=self._line.busy_ns,
            frames=self._line.frames,
            clients=tuple(port.statistics() for port in self._ports if port.receive is not None),
        )._asdict()


def _sharpen_timers() -> None:
    # By default the kernel may wake a sleeper 50 us late, which is half a frame at 1 Mbit/s.
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _TIMER_SLACK_NS, 0, 0, 0)
