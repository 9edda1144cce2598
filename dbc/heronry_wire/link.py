"""One bus of one node: frames in and out of python-can, one frame in flight at a time (protocol rule 13).

A frame that was handed over is *in flight* until its echo comes back: the bus is opened with `receive_own_messages`,
and the echo is known by its identifier and bytes (on one host SocketCAN marks everybody's frames as "not received").
Only then does the next most urgent one follow, so that what becomes urgent meanwhile goes first. An echo that does not
come within `ECHO_TIMEOUT_NS` (bus-off, an overrun of the receive queue) is given up and counted; if it comes after all,
it is still known and taken out.

What arrives is dated: its time-stamp is turned into the monotonic clock, so that whoever was stopped for a while does
not take old frames for news.

A back-end asked to send while the controller's own queue is full (ENOBUFS, a busy mailbox) is tried again a
millisecond later; no error is ever the end of a link that was once open:

    open   frames go in and out
    lost   the interface is down or gone, the hub has ended, the controller is bus-off, or whatever a back-end raises:
           the bus is closed, what waited to be sent is dropped, as is what is sent meanwhile, and every REOPEN_NS it is
           opened again. A SocketCAN interface whose controller is bus-off is restarted before, unless Linux will do it
           (restart-ms); one at another bit rate than was asked for is left alone: speaking there would destroy frames.
           What may take seconds to open (`slow_opening`) is opened beside everything else

`health` says since when it is lost, tells it in sentences, and counts. Only a bus that cannot be opened at the start
raises LinkError, with one sentence; one channel of a replicated bus (`replicated_link`) may begin lost.

A node need not hear everything: `accept` has the kernel (or the hub of a software bus) keep back what means nothing to
it. Filters keep back echoes as well, so an identifier that is sent for the first time is let in before it goes out.

That a back-end echoes, stamps frames by this machine's clock, and has nothing left when it gives nothing, is known of
SocketCAN and the software bus. Others are driven without: there a frame counts as sent when `send` returns, and has
arrived when it is taken; what means nothing is dropped here, and they are asked again while there is something to read.
"""

import select
import socket
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NamedTuple

import can

from heronry_wire.bus_health import BusHealth
from heronry_wire.bus_opening import LinkError, Opened, bus_name, look_at_interface, open_bus
from heronry_wire.controller import ControllerState, read_error_frame
from heronry_wire.errors import HeronryError
from heronry_wire.frame import Frame
from heronry_wire.python_can import frame_of, frames_dropped, is_full, message_of, sentence_of
from heronry_wire.slow_opening import SlowOpening
from heronry_wire.socketcand import see_whether_it_ended
from heronry_wire.transmit_queue import TransmitQueue

ECHO_TIMEOUT_NS = 100_000_000
RETRY_NS = 1_000_000
REOPEN_NS = 250_000_000
STUCK_NS = 1_000_000_000  # nothing has got out for so long
_WELL_KNOWN = ("socketcan", "softbus")
_BURST = 64  # frames taken in one turn: a flood must not starve the timers
_LATE_ECHOES = 16  # how many frames given up are remembered


class Arrival(NamedTuple):
    """A frame and when it arrived, in ns of CLOCK_MONOTONIC."""

    time_ns: int
    frame: Frame


class Link:
    """A python-can bus with a queue in front of it."""

    def __init__(self, config: Mapping[str, Any], *, may_begin_lost: bool = False) -> None:
        """Open the bus that python-can's keyword arguments `config` describe; raises LinkError.

        may_begin_lost: a bus that cannot be opened now is lost, and tried again.
        """
        self.name = bus_name(config)
        self.health = BusHealth(self.name)
        self.echoes_lost = 0
        self.has_more = False  # the last `receive` took a whole burst
        self.queue = TransmitQueue()
        self.on_departure: Callable[[Frame, int, int], None] | None = None  # frame, now_ns, and how long it took
        self._in_flight: Frame | None = None
        self._handed_ns = 0  # when it was handed over
        self._departed: deque[int] = deque(maxlen=_BURST)  # how long frames took to leave, since somebody last asked
        self._given_up: deque[Frame] = deque(maxlen=_LATE_ECHOES)
        self._waiting_since_ns: int | None = None  # for anything that was sent to get out
        self._deadline_ns: int | None = None  # of the echo, of the next try, or of opening the bus again
        self._wanted: frozenset[int] | None = None  # None: everything
        self._sent: set[int] = set()  # identifiers whose echoes must come in
        self._overruns = 0
        self._config = {**config, "receive_own_messages": True}
        self._is_well_known = False
        self._fileno = -1
        self._bus: can.BusABC | None = None
        self._connection: socket.socket | None = None  # that may end without a word
        self._opening: SlowOpening | None = None
        if may_begin_lost:
            self._try_to_open(time.monotonic_ns(), None)
        else:
            self._open()

    @property
    def is_open(self) -> bool:
        """Tell whether there is a descriptor to wait on."""
        return self._bus is not None

    @property
    def readers(self) -> Sequence["Link"]:
        """What to wait on until something has come."""
        return (self,) if self._bus is not None else ()

    @property
    def off_since_ns(self) -> int | None:
        """Since when nothing can be sent or heard; None while something can."""
        return self.health.off_since_ns

    def take_link_events(self) -> list[str]:
        """Give what has befallen the bus since the last call, in sentences."""
        return self.health.take_link_events()

    @property
    def nothing_waits(self) -> bool:
        """Tell whether everything that was sent has been handed over."""
        return not self.queue

    @property
    def all_left(self) -> bool:
        """Tell whether everything that was sent is on the bus."""
        return self._bus is not None and not self.queue and self._deadline_ns is None

    def fileno(self) -> int:
        """Descriptor that is readable when `receive` has something; only while `is_open`."""
        return self._fileno

    def send(self, frame: Frame, now_ns: int, until_ns: int | None = None) -> None:
        """Queue a frame; it goes out when it is the most urgent one and the bus is free, if that is by `until_ns`."""
        if self.put(frame, until_ns):
            self.pump(now_ns)

    def put(self, frame: Frame, until_ns: int | None) -> bool:
        """Queue a frame for the next `pump`; tells whether the bus is there."""
        if self._bus is None:
            self.health.counts["not sent while lost"] += 1
            self._departed.append(0)  # gone, as far as anybody who waits for it goes
            return False
        self.queue.push(frame, until_ns)
        return True

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Take back what waits under these identifiers; what is in flight stays there."""
        self.queue.withdraw(identifiers)

    def stand_back(self, until_ns: int) -> None:
        """Hand nothing over until then but what is more urgent than data."""
        self.queue.stands_back_until_ns = until_ns

    def accept(self, identifiers: Collection[int]) -> None:
        """Take in nothing from now on but frames of these 11-bit identifiers, and the echoes of what is sent."""
        self._wanted = frozenset(identifiers)
        with self._surviving(time.monotonic_ns()):
            self._set_filters()

    def receive(self, now_ns: int) -> list[Arrival]:
        """Take what has arrived, without waiting, at most a burst; own echoes and error frames are taken out."""
        arrivals: list[Arrival] = []
        wall_ns = time.time_ns()
        self.has_more = False
        with self._surviving(now_ns):
            for _ in range(_BURST):
                try:
                    message = None if self._bus is None else self._bus.recv(0)
                except (ValueError, IndexError):  # noise on a serial line: slcan does not look before it reads
                    self.health.counts["not understood"] += 1
                    continue
                if message is None:
                    if self._has_nothing_left():
                        return arrivals
                    continue
                frame = frame_of(message)
                age_ns = max(0, wall_ns - int(message.timestamp * 1e9)) if self._is_well_known else 0
                if frame.error:
                    self._take_error_frame(frame, now_ns)
                elif self._wants(frame) and not self._is_echo(frame, now_ns, age_ns):
                    arrivals.append(Arrival(now_ns - age_ns, frame))
            self.has_more = True
            self._count_overruns(now_ns)
        return arrivals

    def pump(self, now_ns: int) -> None:
        """Hand over the next frame if none is in flight; also to be called when `next_deadline_ns` has come."""
        if self._deadline_ns is not None and now_ns < self._deadline_ns:
            return
        self._deadline_ns = None
        if self._bus is None:
            self._open_again(now_ns)
        if self._in_flight is not None:
            self._given_up.append(self._in_flight)
            self._in_flight = None
            self.echoes_lost += 1
        if self._waiting_since_ns is not None and now_ns - self._waiting_since_ns > STUCK_NS:
            self.health.stuck(now_ns)
        with self._surviving(now_ns):
            while (
                self._bus is not None
                and (frame := self.queue.first(now_ns)) is not None
                and self._hand_over(self._bus, frame, now_ns)
            ):
                pass

    def next_deadline_ns(self) -> int | None:
        """When to call `pump` at the latest."""
        if self._deadline_ns is None and len(self.queue):
            return self.queue.stands_back_until_ns
        return self._deadline_ns

    def close(self) -> None:
        """Close the bus."""
        if self._opening is not None:
            self._opening.abandon()
            self._opening = None
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    @contextmanager
    def _surviving(self, now_ns: int) -> Iterator[None]:
        """Whatever the bus raises in here, it is lost, and nothing else happens."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - a back-end may raise anything
            self._lose(sentence_of(error), now_ns)

    def _lose(self, reason: str, now_ns: int) -> None:
        with suppress(Exception):  # it is broken, and may say so again
            self.close()
        self._bus = None
        self.health.lost(now_ns, reason)
        dropped = self.queue.clear() + (self._in_flight is not None)
        self.health.counts["not sent while lost"] += dropped
        self._departed.extend([0] * dropped)
        self._in_flight = self._waiting_since_ns = None
        self._given_up.clear()
        self._deadline_ns = now_ns + REOPEN_NS

    def _open(self, opened: Opened | None = None) -> None:
        """Open the bus, unless it has been opened, and see that it works; raises LinkError."""
        look_at_interface(self._config)
        bus, self._fileno, self._connection = opened or open_bus(self._config)
        try:
            bus.recv(0)  # an interface that is down can be opened, and says so here
            look_at_interface(self._config)  # again: it may have come up, at another bit rate, in between
            self._bus = bus
            self._is_well_known = bus.channel_info.partition(" ")[0] in _WELL_KNOWN
            self._set_filters()
        except Exception as error:
            self._bus = None
            bus.shutdown()
            if isinstance(error, LinkError):
                raise
            raise LinkError(f"{self.name} cannot be opened: {sentence_of(error)}") from error
        self._overruns = 0

    def _open_again(self, now_ns: int) -> None:
        if self._is_well_known or self._config.get("interface") in _WELL_KNOWN:
            self._try_to_open(now_ns, None)
            return
        self._opening = self._opening or SlowOpening(partial(open_bus, self._config))
        result = self._opening.result
        if result is None:
            self._deadline_ns = now_ns + REOPEN_NS
            return
        self._opening = None
        self._try_to_open(now_ns, result)

    def _try_to_open(self, now_ns: int, result: Opened | HeronryError | None) -> None:
        """Open the bus now, or take what a try of its own has come to."""
        try:
            if isinstance(result, HeronryError):
                raise result
            self._open(result)
        except HeronryError as error:
            self.health.lost(now_ns, str(error).partition(": ")[2])
            self._deadline_ns = now_ns + REOPEN_NS
        else:
            self.health.back(now_ns)

    def departures_ns(self) -> list[int]:
        """How long each frame that has left since the last call was in the controller; 0 where nobody knows."""
        departed = list(self._departed)
        self._departed.clear()
        return departed

    def _is_echo(self, frame: Frame, now_ns: int, age_ns: int) -> bool:
        """Tell whether a frame is one of our own, and let the next one follow."""
        if frame == self._in_flight:
            self._left(frame, now_ns, max(1, now_ns - age_ns - self._handed_ns))
            self._in_flight = self._deadline_ns = self._waiting_since_ns = None
            self.pump(now_ns)
            return True
        if frame in self._given_up:
            self._given_up.remove(frame)
            self._waiting_since_ns = None
            return True
        return False

    def _left(self, frame: Frame, now_ns: int, took_ns: int) -> None:
        self._departed.append(took_ns)
        if self.on_departure is not None:
            self.on_departure(frame, now_ns, took_ns)

    def _take_error_frame(self, frame: Frame, now_ns: int) -> None:
        report = read_error_frame(frame)
        self.health.reported(report, now_ns)
        if report.state is ControllerState.BUS_OFF:
            self._lose("its controller is bus-off", now_ns)

    def _count_overruns(self, now_ns: int) -> None:
        """After a full burst: see whether there was more than SocketCAN had room for."""
        dropped = 0 if self._bus is None else frames_dropped(self._bus)
        self.health.overrun(dropped - self._overruns, now_ns)
        self._overruns = dropped

    def _has_nothing_left(self) -> bool:
        """After nothing was given, which may have been an answer of a modem; raises OSError where there is no more."""
        if self._is_well_known or self._bus is None:
            return True
        if self._connection is not None:
            see_whether_it_ended(self._connection)
        return not select.select([self._fileno], [], [], 0)[0]

    def _wants(self, frame: Frame) -> bool:
        """Tell whether a frame means anything; filters have seen to it where they are known to."""
        if self._is_well_known or self._wanted is None:
            return True
        return frame.can_id in self._wanted and not frame.extended

    def _set_filters(self) -> None:
        if self._wanted is None or self._bus is None or not self._is_well_known:
            return
        accepted = sorted(self._wanted | self._sent)
        self._bus.set_filters([{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in accepted])

    def _hand_over(self, bus: can.BusABC, frame: Frame, now_ns: int) -> bool:
        """Send the first frame of the queue; tells whether another may follow at once."""
        if frame.can_id not in self._sent:
            self._sent.add(frame.can_id)
            self._set_filters()
        if self._waiting_since_ns is None:
            self._waiting_since_ns = now_ns
        try:
            bus.send(message_of(frame), timeout=0)
        except (can.CanError, OSError) as error:
            if not is_full(error):
                raise
            self.health.counts["queue full"] += 1
            self._deadline_ns = now_ns + RETRY_NS
            return False
        self.queue.pop()
        if self._is_well_known:
            self._in_flight, self._deadline_ns, self._handed_ns = frame, now_ns + ECHO_TIMEOUT_NS, now_ns
        else:
            self._left(frame, now_ns, 0)
            self._waiting_since_ns = None
        return not self._is_well_known
