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

That a back-end echoes, and stamps frames by this machine's clock, is known of SocketCAN and the software bus. Others
are driven without: there a frame counts as sent when `send` returns, and has arrived when it is taken.
"""

import errno
import logging
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NamedTuple

import can

from heronry_wire.bus_health import BusHealth
from heronry_wire.can_interface import CanInterface, read_interface, take_down_and_up
from heronry_wire.controller import ControllerState, read_error_frame
from heronry_wire.errors import HeronryError
from heronry_wire.frame import Frame
from heronry_wire.slow_opening import Opened, SlowOpening
from heronry_wire.transmit_queue import TransmitQueue

ECHO_TIMEOUT_NS = 100_000_000
RETRY_NS = 1_000_000
REOPEN_NS = 250_000_000
STUCK_NS = 1_000_000_000  # nothing has got out for so long
_WELL_KNOWN = ("socketcan", "softbus")
_SOCKETCAND = "socketcand"
_SERVER_S = 2.0  # to answer
_BURST = 64  # frames taken in one turn: a flood must not starve the timers
_LATE_ECHOES = 16  # how many frames given up are remembered
_SO_MEMINFO, _MEMINFO_DROPS = 55, 8  # Linux, socket(7): nine counters, the last are frames dropped for want of room
_REMEDIES = {
    errno.EAFNOSUPPORT: "this kernel has no CAN: use a software bus, or run under tools/with-vcan",
    errno.ENODEV: "there is no such interface: 'ip link' lists those there are",
    errno.ENETDOWN: "the interface is down: 'ip link set NAME up' brings it up",
}


class LinkError(HeronryError):
    """The bus cannot be used; the message is one sentence with a remedy where there is one."""


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
        self.name = _name(config)
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
        self._interface = config.get("channel") if config.get("interface") == "socketcan" else None
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

    def take_news(self) -> list[str]:
        """Give what has befallen the bus since the last call, in sentences."""
        return self.health.take_news()

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
                    self._see_whether_it_ended()
                    return arrivals
                frame = frame_of(message)
                age_ns = max(0, wall_ns - int(message.timestamp * 1e9)) if self._is_well_known else 0
                if frame.error:
                    self._take_error_frame(frame, now_ns)
                elif not self._is_echo(frame, now_ns, age_ns):
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
            self._lose(_sentence(error), now_ns)

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
        self._look_at_interface()
        bus, self._fileno = opened or open_bus(self._config)
        try:
            bus.recv(0)  # an interface that is down can be opened, and says so here
            self._look_at_interface()  # again: it may have come up, at another bit rate, in between
            self._bus = bus
            self._set_filters()
        except Exception as error:
            self._bus = None
            bus.shutdown()
            if isinstance(error, LinkError):
                raise
            raise LinkError(f"{self.name} cannot be opened: {_sentence(error)}") from error
        self._overruns = 0
        kind = bus.channel_info.partition(" ")[0]
        self._is_well_known = kind in _WELL_KNOWN
        self._connection = connection_of(bus) if kind == _SOCKETCAND else None

    def _look_at_interface(self) -> None:
        obstacle = None if self._interface is None else _obstacle(self._interface, self._config.get("bitrate"))
        if obstacle is not None:
            raise LinkError(f"{self.name} cannot be opened: {obstacle}")

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

    def _see_whether_it_ended(self) -> None:
        """A connection that its server has closed is readable for ever, and python-can says nothing of it."""
        with suppress(BlockingIOError):
            if self._connection is not None and not self._connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT):
                raise ConnectionResetError("its server has closed the connection")

    def _count_overruns(self, now_ns: int) -> None:
        """After a full burst: ask SocketCAN how many frames it had to drop."""
        raw = getattr(self._bus, "socket", None)
        if isinstance(raw, socket.socket):
            counters = raw.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 4 * (_MEMINFO_DROPS + 1))
            dropped = struct.unpack(f"={_MEMINFO_DROPS + 1}I", counters)[_MEMINFO_DROPS]
            self.health.overrun(dropped - self._overruns, now_ns)
            self._overruns = dropped

    def _set_filters(self) -> None:
        if self._wanted is None or self._bus is None:
            return
        accepted = sorted(self._wanted | self._sent)
        self._bus.set_filters([{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in accepted])

    def _hand_over(self, bus: can.BusABC, frame: Frame, now_ns: int) -> bool:
        """Send the first frame of the queue; tells whether another may follow at once."""
        if frame.can_id not in self._sent:
            self._sent.add(frame.can_id)
            self._set_filters()
        message = can.Message(
            arbitration_id=frame.can_id, is_extended_id=frame.extended, is_remote_frame=frame.remote, data=frame.data
        )
        if self._waiting_since_ns is None:
            self._waiting_since_ns = now_ns
        try:
            bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            if not _is_full(error):
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


def _obstacle(name: str, bitrate: int | None) -> str | None:
    """Why a SocketCAN interface should not be used now; restarts one that is bus-off. None: nothing known against."""
    interface = read_interface(name)
    if interface is None or not interface.is_up:
        return None  # opening it tells
    if interface.state is ControllerState.BUS_OFF:
        return _restarted(interface)
    if bitrate is not None and interface.bitrate not in (None, bitrate):
        mend = f"ip link set {name} down && ip link set {name} up type can bitrate {bitrate}"
        return f"it runs at {interface.bitrate} bit/s, and this bus at {bitrate}: '{mend}'"
    return None


def _restarted(interface: CanInterface) -> str | None:
    name = interface.name
    if interface.restart_ms:
        return f"its controller is bus-off; Linux restarts it after {interface.restart_ms} ms"
    try:
        take_down_and_up(name)
    except OSError:
        mend = f"ip link set {name} down && ip link set {name} up type can restart-ms 100"
        return f"its controller is bus-off, and this user may not restart it: '{mend}'"
    return None


def open_bus(config: Mapping[str, Any]) -> tuple[can.BusABC, int]:
    """Open the bus that python-can's keyword arguments describe, with its descriptor; raises LinkError.

    A socketcand is named by its channel: INTERFACE@HOST:PORT.
    """
    name = _name(config)
    try:
        bus = _open_at_server(config) if config.get("interface") == _SOCKETCAND else can.Bus(**config)
    except can.CanInterfaceNotImplementedError as error:
        if "interface" in config:
            raise LinkError(f"{name} cannot be opened: {_sentence(error)}") from error
        raise LinkError("no bus is named: give -i INTERFACE and -c CHANNEL, or set them in can.conf") from error
    except Exception as error:  # a back-end without its library raises whatever comes to it, a NameError even
        raise LinkError(f"{name} cannot be opened: {_sentence(error)}") from error
    try:
        return bus, bus.fileno()
    except NotImplementedError:
        connection = connection_of(bus)
        if connection is not None:
            return bus, connection.fileno()
        bus.shutdown()
        remedy = "use socketcan, softbus, or another that has one"
        raise LinkError(f"{name} has no file descriptor to wait on; {remedy}") from None


def connection_of(bus: can.BusABC) -> socket.socket | None:
    """The connection of a back-end that keeps one and does not tell of it, as python-can's socketcand; or None."""
    return next((kept for kept in vars(bus).values() if isinstance(kept, socket.socket)), None)


def _open_at_server(config: Mapping[str, Any]) -> can.BusABC:
    """Open a socketcand; python-can would wait for its server without end, and try to reach it without a pause."""
    place = _at_its_server(config)
    if "host" in place:
        socket.create_connection((place["host"], place["port"]), _SERVER_S).close()
    logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)  # it warns of every frame cut in two
    before_s = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_SERVER_S)
    try:
        bus = can.Bus(**place)
    finally:
        socket.setdefaulttimeout(before_s)
    connection = connection_of(bus)
    if connection is not None:
        connection.settimeout(None)
    return bus


def _at_its_server(config: Mapping[str, Any]) -> dict[str, Any]:
    """Take the channel of a socketcand apart; where it names no server, can.conf has to."""
    channel, at, server = str(config.get("channel") or "").rpartition("@")
    if not at:
        return dict(config)
    host, _, port = server.rpartition(":")
    if not channel or not host or not port.isdecimal():
        raise ValueError(f"a socketcand is named INTERFACE@HOST:PORT, such as can0@192.168.1.5:29536, not '{server}'")
    return {**config, "channel": channel, "host": host, "port": int(port)}


def _name(config: Mapping[str, Any]) -> str:
    return f"{config.get('interface') or 'the configured interface'} {config.get('channel') or ''}".strip()


def frame_of(message: can.Message) -> Frame:
    """Give a frame of python-can as one of ours."""
    return Frame(
        message.arbitration_id,
        b"" if message.is_remote_frame else bytes(message.data),
        message.is_extended_id,
        message.is_remote_frame,
        message.is_error_frame,
    )


def _is_full(error: Exception) -> bool:
    """Tell whether a send failed only because the controller's queue is full."""
    if isinstance(error, can.CanError) and error.error_code is None:
        return "buffer full" in str(error)  # python-can 4.6 on SocketCAN, when its socket is not writable
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code in (errno.ENOBUFS, errno.EAGAIN)


def _sentence(error: BaseException) -> str:
    """First line of an error, without a full stop, or what to do where we know better."""
    code = error.errno if isinstance(error, OSError) else getattr(error, "error_code", None)
    if code in _REMEDIES:
        return _REMEDIES[code]
    cause = error.__cause__ if isinstance(error.__cause__, OSError) and not str(error) else error
    return str(cause).strip().splitlines()[0].rstrip(".") if str(cause).strip() else type(error).__name__
