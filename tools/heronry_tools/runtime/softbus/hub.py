"""The hub of a software bus: one process with a single `select` loop, no threads and no locks.

The hub decides which clients may connect. It passes the frames that clients offer to the line (`line.py`), and
each frame that has left the line to the clients.

Each round of the loop takes these steps:

1. It sleeps while nothing that comes could matter (see *Gathering*).
2. It notes the time.
3. It sleeps until a record comes, or until the line has to advance.
4. It reads all records that have come.
5. It lets the line advance to the noted time, and passes on what has left the line.

So no offer that was made before the noted time is overlooked. An offer that ends the sleep is newer than the
noted time, so the line does not start it in this round. The next round reads without a sleep. All offers that
were made until then take part in the arbitration.

*Gathering.* As a network driver does, the hub gathers frames instead of waking for each: a frame that is not
urgent is passed on up to `GATHER_NS` after its end, together with the others. The line stays exact, since every offer
has the time at which it was made. What a sender says of its frame (`Haste`) decides:

    urgent     every frame is passed on at its end, also those of the next `ALERT_NS`. Meanwhile the hub does not
               gather. While a frame is on the air it does not even look for offers: they cannot start before its end
    prompt     the echo is passed on at the end of the frame, so that its sender can offer the next one
    patient    the echo has up to `ECHO_NS`: it goes with the next frame for this client, and wakes nobody

A receiver may also have a group of frames thinned (`heronry_wire.thinning`): then repeated states do not wake it.

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
from typing import Any, NamedTuple

from heronry_tools.runtime.softbus.address import Address
from heronry_tools.runtime.softbus.line import NS_PER_S, Line, Transmission
from heronry_tools.runtime.softbus.port import Port
from heronry_tools.runtime.softbus.protocol import (
    PROTOCOL_VERSION,
    RECORD_BYTES,
    WANT_ECHO,
    BusFrame,
    BusStatistics,
    decode_command,
    decode_filters,
    decode_frame,
    decode_thinned,
    decode_withdrawal,
    encode_command,
    encode_received,
    is_command,
)
from heronry_wire.frame import Frame, Malformed
from heronry_wire.frame_port import Haste
from heronry_wire.protocol_times import GATHER_NS

MAX_CLIENTS = 400
"""A client takes two descriptors, and `select` takes none above 1023."""

_MAX_CONNECTIONS = (
    MAX_CLIENTS + 100
)  # a client above MAX_CLIENTS is told that the bus is full; connections above this number wait

ALERT_NS = 20_000_000
ECHO_NS = 30_000_000

_NEVER_NS = 1 << 62
_MOST_ROUTES = 8192
_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_TIMER_SLACK_NS = 1_000


class _Route(NamedTuple):
    """The ports that accept the frames of one identifier: all of these frames, or what they need of a group."""

    all_of_it: list[Port]
    thinned: list[Port]


class Hub:
    """A bus of `bitrate` (bit/s) at the UNIX socket `path`. Raises HubError when the path cannot be used."""

    def __init__(self, path: Path, bitrate: int) -> None:
        self._address = Address(path)
        self._line = Line(bitrate)
        self._ports: list[Port] = []
        self._by_fd: dict[int, Port] = {}
        self._by_number: dict[int, Port] = {}
        self._last_number = 0
        self._loss_per_mille = 0
        self._random = Random(0)
        self._routes: dict[tuple[int, bool], _Route] = {}
        self._held: dict[int, Port] = {}  # ports with frames that were not passed on, by number
        self._echoes: dict[int, Port] = {}  # ports with nothing but patient echoes
        self._flush_ns = _NEVER_NS  # when to pass them on
        self._echo_ns = _NEVER_NS  # when to pass on echoes for which nobody waits
        self._alert_until_ns = 0
        self._looked_ns = time.monotonic_ns()
        self._day_offset_ns = time.time_ns() - self._looked_ns  # only to date frames for people

    def run(self, stop_fds: Iterable[int]) -> None:
        """Serve the bus until one of `stop_fds` becomes readable."""
        _sharpen_timers()
        stops = frozenset(stop_fds)
        listener_fd = self._address.listener.fileno()
        while True:
            has_gathered = self._gather(stops)
            noted_ns = time.monotonic_ns()
            watched = [*stops, *self._by_fd]
            if len(self._ports) < _MAX_CONNECTIONS:
                watched.append(listener_fd)
            clogged = [port for port in self._ports if port.queue and port.number not in self._held | self._echoes]
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
            if (has_gathered and self._flush_ns != _NEVER_NS) or noted_ns >= min(self._flush_ns, self._echo_ns):
                self._flush(noted_ns)
            self._looked_ns = noted_ns

    def _gather(self, stops: frozenset[int]) -> bool:
        """Sleep without a look at the clients while nothing that they send could matter.

        Tells whether frames have been gathered for long enough.
        """
        now_ns, due_ns, gathered_ns = time.monotonic_ns(), self._line.next_deadline_ns(), _NEVER_NS
        if now_ns < self._alert_until_ns:
            end_ns = min(self._line.on_air_until_ns() or 0, now_ns + GATHER_NS)
        elif due_ns is None and self._flush_ns == _NEVER_NS:
            return False
        else:
            gathered_ns = min(self._flush_ns, now_ns + GATHER_NS)
            end_ns = min(gathered_ns, due_ns) if due_ns is not None and self._line.hurries() else gathered_ns
        if end_ns > now_ns:
            select.select(stops, [], [], (end_ns - now_ns) / NS_PER_S)
        return end_ns == gathered_ns

    def close(self) -> None:
        """Disconnect every client and remove the socket."""
        self._address.close()
        for port in self._ports:
            port.close()

    def _sleep_s(self, now_ns: int) -> float | None:
        line_ns = self._line.next_deadline_ns()
        deadline_ns = min(_NEVER_NS if line_ns is None else line_ns, self._flush_ns, self._echo_ns)
        return None if deadline_ns == _NEVER_NS else max(0, deadline_ns - now_ns) / NS_PER_S

    def _connect(self) -> None:
        try:
            command, _ = self._address.listener.accept()
        except OSError:
            return  # the client has gone again
        self._last_number += 1
        port = Port(self._last_number, command)
        self._ports.append(port)
        self._by_fd[command.fileno()] = self._by_number[port.number] = port
        self._routes.clear()

    def _serve(self, port: Port) -> None:
        record, descriptors = port.read()
        if not record:
            return
        if port.receive is None:
            problem = self._welcome(port, record, descriptors)
        elif is_command(record):
            problem = self._accept(port, record)
        elif record == WANT_ECHO:
            self._hurry(port)
            return
        elif port.batched and (identifiers := decode_withdrawal(record)) is not None:
            self._withdraw(port, identifiers)
            return
        elif port.batched and len(record) > RECORD_BYTES:
            parts = (record[begin : begin + RECORD_BYTES] for begin in range(0, len(record), RECORD_BYTES))
            problem = next((found for part in parts if (found := self._take_offer(port, part)) is not None), None)
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
        command = decode_command(record)
        match command:
            case {"do": "filters", "filters": None}:
                port.set_filters(None)
                self._routes.clear()
                port.answer(encode_command({}))
            case {"do": "batches"}:
                port.batched = True
                port.answer(encode_command({}))
            case {"do": "thin"} if isinstance(command, dict):
                group = decode_thinned(command)
                if isinstance(group, Malformed):
                    return group
                port.thin(group)
                self._routes.clear()
                port.answer(encode_command({}))
            case {"do": "filters", "filters": content}:
                filters = decode_filters(content)
                if isinstance(filters, Malformed):
                    return filters
                port.set_filters(filters)
                self._routes.clear()
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
        if not port.has_room:
            return Malformed("a frame was offered before the last one had left the bus")
        # The sender's clock is ours; a stamp outside of the time since the last look is not used.
        now_ns = time.monotonic_ns()
        offered_ns = min(max(offered.time_ns, self._looked_ns), now_ns)
        if offered.haste is Haste.URGENT:
            self._alert_until_ns = now_ns + ALERT_NS
        port.offered += 1
        self._line.offer(port.number, BusFrame(offered.frame, offered.dlc, offered_ns, haste=offered.haste))
        return None

    def _withdraw(self, port: Port, identifiers: frozenset[int]) -> None:
        """Take back what a client has offered under these identifiers and what has not begun."""
        for offered in self._line.withdraw(port.number, identifiers):
            port.withdrawn(offered.frame, offered.dlc, self._looked_ns)
            self._held[port.number] = port
            self._flush_ns = min(self._flush_ns, self._looked_ns + GATHER_NS)

    def _hurry(self, port: Port) -> None:
        """Pass on the echo for which a client waits now: at once, or when its frame has left."""
        self._pass_on(port)
        if port.offered:
            self._line.hurry(port.number)

    def _hand_over(self, gone: Transmission) -> None:
        """Give a frame that has left the line to the ports that accept it, and pass on what may not wait."""
        frame, dlc, _, _, haste = gone.sent
        route = self._routes.get((frame.can_id, frame.extended)) or self._route(frame)
        record, held = encode_received(frame, dlc, gone.end_ns), self._held
        for port in route.all_of_it:
            if port.number != gone.client and not self._is_missed():
                port.deliver(record)
                held[port.number] = port
        for port in route.thinned:
            if port.number != gone.client and not port.drops(frame, gone.end_ns) and not self._is_missed():
                port.deliver(record)
                held[port.number] = port
        if held:
            self._flush_ns = min(self._flush_ns, gone.end_ns + GATHER_NS)
        sender = self._by_number.get(gone.client)
        if sender is not None:
            self._confirm(sender, gone)
        if haste is Haste.URGENT or gone.end_ns < self._alert_until_ns:
            self._flush(gone.end_ns)

    def _confirm(self, sender: Port, gone: Transmission) -> None:
        """Echo a frame to its sender: at once, or with the next frame for this client."""
        frame, dlc, _, _, haste = gone.sent
        sender.confirm(frame, dlc, gone.end_ns)
        if haste is Haste.PATIENT:
            self._echoes[sender.number] = sender
            self._echo_ns = min(self._echo_ns, gone.end_ns + ECHO_NS)
        else:
            self._pass_on(sender)

    def _pass_on(self, port: Port) -> None:
        """Pass on what is held back for a client."""
        self._held.pop(port.number, None)
        self._echoes.pop(port.number, None)
        port.flush()

    def _flush(self, now_ns: int) -> None:
        """Pass on all frames that are held back, and with each its receiver's echoes."""
        for number, port in self._held.items():
            self._echoes.pop(number, None)
            port.flush()
        self._held.clear()
        self._flush_ns = _NEVER_NS
        if now_ns >= self._echo_ns or not self._echoes:
            for port in self._echoes.values():
                port.flush()
            self._echoes.clear()
            self._echo_ns = _NEVER_NS

    def _route(self, frame: Frame) -> "_Route":
        """Find the ports that accept frames like this one, and keep them until a filter changes."""
        if len(self._routes) >= _MOST_ROUTES:
            self._routes.clear()
        ports = [port for port in self._ports if port.accepts(frame.can_id, extended=frame.extended)]
        thinned = [] if frame.extended else [port for port in ports if port.thins(frame.can_id)]
        route = _Route([port for port in ports if port not in thinned], thinned)
        self._routes[frame.can_id, frame.extended] = route
        return route

    def _is_missed(self) -> bool:
        """Decide at random whether a receiver misses a frame, as a receiver of a bad radio does."""
        return self._loss_per_mille > 0 and self._random.randrange(1000) < self._loss_per_mille

    def _remove_the_gone(self) -> None:
        for port in [port for port in self._ports if port.gone]:
            self._ports.remove(port)
            del self._by_fd[port.command.fileno()], self._by_number[port.number]
            self._held.pop(port.number, None)
            self._echoes.pop(port.number, None)
            self._routes.clear()
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
