"""One bus of one node: frames in and out of python-can, one frame in flight at a time (protocol rule 13).

A frame that was handed over is *in flight* until its echo comes back: the bus is opened with `receive_own_messages`,
and the echo is known by its identifier and bytes (on one host SocketCAN marks everybody's frames as "not received").
Only then does the next most urgent one follow, so that what becomes urgent meanwhile goes first. An echo that does not
come within `ECHO_TIMEOUT_NS` (bus-off, an overrun of the receive queue) is given up and counted; if it comes after all,
it is still known and taken out.

What arrives is dated: its time-stamp is turned into the monotonic clock, so that whoever was stopped for a while does
not take old frames for news.

A back-end asked to send while the controller's own queue is full (ENOBUFS, a busy mailbox) is tried again a
millisecond later. Anything else that goes wrong with the bus raises LinkError with one sentence: no agent flies on a
dead link.

A node need not hear everything: `accept` has the kernel (or the hub of a software bus) keep back what means nothing to
it. Filters keep back echoes as well, so an identifier that is sent for the first time is let in before it goes out.

That a back-end echoes, and stamps frames by this machine's clock, is known of SocketCAN and the software bus. Others
are driven without: there a frame counts as sent when `send` returns, and has arrived when it is taken.
"""

import errno
import time
from collections import deque
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import can

from heronry_wire.errors import HeronryError
from heronry_wire.frame import Frame
from heronry_wire.transmit_queue import TransmitQueue

ECHO_TIMEOUT_NS = 100_000_000
RETRY_NS = 1_000_000
_WELL_KNOWN = ("socketcan", "softbus")
_BURST = 64  # frames taken in one turn: a flood must not starve the timers
_LATE_ECHOES = 16  # how many frames given up are remembered
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

    def __init__(self, config: Mapping[str, Any]) -> None:
        """Open the bus that python-can's keyword arguments `config` describe; raises LinkError."""
        self.name = _name(config)
        self.echoes_lost = 0
        self.queue = TransmitQueue()
        self._in_flight: Frame | None = None
        self._given_up: deque[Frame] = deque(maxlen=_LATE_ECHOES)
        self._deadline_ns: int | None = None  # of the echo, or of the next try
        self._wanted: frozenset[int] | None = None  # None: everything
        self._sent: set[int] = set()  # identifiers whose echoes must come in
        self._bus, self._fileno = open_bus({**config, "receive_own_messages": True})
        self._is_well_known = self._bus.channel_info.startswith(_WELL_KNOWN)

    def fileno(self) -> int:
        """Descriptor that is readable when `receive` has something."""
        return self._fileno

    def send(self, frame: Frame, now_ns: int, until_ns: int | None = None) -> None:
        """Queue a frame; it goes out when it is the most urgent one and the bus is free, if that is by `until_ns`."""
        self.queue.push(frame, until_ns)
        self.pump(now_ns)

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Take back what waits under these identifiers; what is in flight stays there."""
        self.queue.withdraw(identifiers)

    def accept(self, identifiers: Collection[int]) -> None:
        """Take in nothing from now on but frames of these 11-bit identifiers, and the echoes of what is sent."""
        self._wanted = frozenset(identifiers)
        self._set_filters()

    def receive(self, now_ns: int) -> list[Arrival]:
        """Take what has arrived, without waiting, at most a burst; own echoes are taken out."""
        arrivals = []
        wall_ns = time.time_ns()
        try:
            for _ in range(_BURST):
                message = self._bus.recv(0)
                if message is None:
                    break
                frame = _frame_of(message)
                if not self._is_echo(frame, now_ns):
                    age_ns = max(0, wall_ns - int(message.timestamp * 1e9)) if self._is_well_known else 0
                    arrivals.append(Arrival(now_ns - age_ns, frame))
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name} is lost: {_sentence(error)}") from error
        return arrivals

    def pump(self, now_ns: int) -> None:
        """Hand over the next frame if none is in flight; also to be called when `next_deadline_ns` has come."""
        if self._deadline_ns is not None and now_ns < self._deadline_ns:
            return
        if self._in_flight is not None:
            self._given_up.append(self._in_flight)
            self._in_flight = None
            self.echoes_lost += 1
        self._deadline_ns = None
        while (frame := self.queue.first(now_ns)) is not None and self._hand_over(frame, now_ns):
            pass

    def next_deadline_ns(self) -> int | None:
        """When to call `pump` at the latest."""
        return self._deadline_ns

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()

    def _is_echo(self, frame: Frame, now_ns: int) -> bool:
        """Tell whether a frame is one of our own, and let the next one follow."""
        if frame == self._in_flight:
            self._in_flight = self._deadline_ns = None
            self.pump(now_ns)
            return True
        if frame in self._given_up:
            self._given_up.remove(frame)
            return True
        return False

    def _set_filters(self) -> None:
        if self._wanted is None:
            return
        accepted = sorted(self._wanted | self._sent)
        try:
            self._bus.set_filters([{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in accepted])
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name} is lost: {_sentence(error)}") from error

    def _hand_over(self, frame: Frame, now_ns: int) -> bool:
        """Send the first frame of the queue; tells whether another may follow at once."""
        if frame.can_id not in self._sent:
            self._sent.add(frame.can_id)
            self._set_filters()
        message = can.Message(
            arbitration_id=frame.can_id, is_extended_id=frame.extended, is_remote_frame=frame.remote, data=frame.data
        )
        try:
            self._bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            if not _is_full(error):
                raise LinkError(f"{self.name} is lost: {_sentence(error)}") from error
            self._deadline_ns = now_ns + RETRY_NS
            return False
        self.queue.pop()
        if self._is_well_known:
            self._in_flight, self._deadline_ns = frame, now_ns + ECHO_TIMEOUT_NS
        return not self._is_well_known


def open_bus(config: Mapping[str, Any]) -> tuple[can.BusABC, int]:
    """Open the bus that python-can's keyword arguments describe, with its descriptor; raises LinkError."""
    name = _name(config)
    try:
        bus = can.Bus(**config)
    except can.CanInterfaceNotImplementedError as error:
        if "interface" in config:
            raise LinkError(f"{name} cannot be opened: {_sentence(error)}") from error
        raise LinkError("no bus is named: give -i INTERFACE and -c CHANNEL, or set them in can.conf") from error
    except Exception as error:  # a back-end without its library raises whatever comes to it, a NameError even
        raise LinkError(f"{name} cannot be opened: {_sentence(error)}") from error
    try:
        return bus, bus.fileno()
    except NotImplementedError:
        bus.shutdown()
        remedy = "use socketcan, softbus, or another that has one"
        raise LinkError(f"{name} has no file descriptor to wait on; {remedy}") from None


def _name(config: Mapping[str, Any]) -> str:
    return f"{config.get('interface') or 'the configured interface'} {config.get('channel') or ''}".strip()


def _frame_of(message: can.Message) -> Frame:
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
