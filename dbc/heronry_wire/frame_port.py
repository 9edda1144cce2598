"""Frames in and out of one open bus, without python-can's messages where its interface allows.

A message of python-can costs as much as all that follows from the frame: it is made with a dozen keyword arguments,
checked, logged and copied. So frames go around it:

    software bus   by `frame_port()` of its bus, many frames in one packet
    SocketCAN      by the raw socket of its bus
    other          by `recv` and `send` of python-can

A port may raise any exception of its back-end; `heronry_wire.link` handles that. `Haste` says how long a frame and its
echo may take beyond their time on the bus. Only the software bus can make use of it.
"""

import socket
from collections.abc import Callable
from enum import Enum
from struct import Struct
from typing import Final, NamedTuple, Protocol

from heronry_wire.arrival_times import ArrivalTimes
from heronry_wire.bare_can import can
from heronry_wire.frame import EXTENDED_MASK, STANDARD_MASK, Frame
from heronry_wire.python_can import frame_of, message_of
from heronry_wire.thinning import Thinned, Thinning

WELL_KNOWN: Final = ("socketcan", "softbus")
"""The back-ends that echo frames, and stamp them with this computer's clock."""

_CAN_FRAME = Struct("=IB3x8s")  # struct can_frame of linux/can.h
_TIMESPEC = Struct("@ll")
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size)
_NS_PER_S = 1_000_000_000


class Haste(Enum):
    """How soon a frame is needed by its receivers, and its echo by its sender."""

    URGENT = "both at once, and so are the frames of the next moments"
    PROMPT = "the echo at once: another frame waits behind this one"
    PATIENT = "either may take a moment"


class Arrival(NamedTuple):
    """A frame and its time of arrival, in ns of CLOCK_MONOTONIC."""

    time_ns: int
    frame: Frame


class FramePort(Protocol):
    """One open bus."""

    @property
    def gathers(self) -> bool:
        """Tell whether the bus itself gathers frames for a moment, so that its reader need not."""

    def read(self, now_ns: int, most: int) -> tuple[list[Arrival], bool]:
        """Read frames without waiting, and tell whether more may wait; `most`: how many are read, about.

        now_ns: the present time; no frame arrives later.
        """

    def send(self, frame: Frame, haste: Haste) -> None:
        """Hand a frame to the controller; where it has no room, raises an error for which `is_full` is true.

        The frame may stay here until `flush`.
        """

    def flush(self) -> None:
        """Hand over what `send` has kept."""

    @property
    def mailboxes(self) -> int:
        """Return how many frames the controller takes at once; more than one only if they compete by priority."""

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Take back the 11-bit frames with these identifiers that have not left; only with several mailboxes."""

    def want_echo(self) -> None:
        """Ask for the echo of the frame in flight as soon as it has left: another frame waits now."""

    def thin(self, group: Thinned) -> None:
        """From now on, pass on only what `group` needs of its identifiers."""


class MessagePort:
    """A bus of any back-end, by the messages of python-can.

    counts_noise is called for each message that a back-end cannot understand.
    """

    gathers = False
    mailboxes = 1

    def __init__(
        self, bus: can.BusABC, *, is_well_known: bool, has_nothing_left: Callable[[], bool], noise: Callable[[], None]
    ) -> None:
        """has_nothing_left: tells, after `recv` has given None, whether nothing is left to read.

        noise: is called for bytes that the back-end does not understand.
        """
        self._bus, self._is_well_known = bus, is_well_known
        self._has_nothing_left, self._noise = has_nothing_left, noise
        self._times = ArrivalTimes()

    def read(self, now_ns: int, most: int) -> tuple[list[Arrival], bool]:
        """Read frames by `recv`."""
        found: list[Arrival] = []
        self._times.look()
        for _ in range(most):
            try:
                message = self._bus.recv(0)
            except (ValueError, IndexError):  # noise on a serial line: slcan does not check what it reads
                self._noise()
                continue
            if message is not None:
                age_ns = self._times.age_ns(message) if self._is_well_known else 0
                found.append(Arrival(now_ns - age_ns, frame_of(message)))
            elif self._has_nothing_left():
                self._times.found_empty()
                return found, False
        return found, True

    def send(self, frame: Frame, haste: Haste) -> None:  # noqa: ARG002 - python-can has no notion of it
        """Send by `send`."""
        self._bus.send(message_of(frame), timeout=0)

    def flush(self) -> None:
        """Do nothing: each frame goes at once."""

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Do nothing: the one frame that the controller has is sent."""

    def want_echo(self) -> None:
        """Do nothing: an echo comes as soon as it can."""

    def thin(self, group: Thinned) -> None:
        """Do nothing: all frames are passed on."""


class SocketCanPort:
    """The raw socket of a SocketCAN bus.

    A frame that need not pass is dropped before an object is made for it.
    """

    gathers = False
    mailboxes = 1

    def __init__(self, raw: socket.socket) -> None:
        self._raw, self._times = raw, ArrivalTimes()
        self._thinning: Thinning | None = None

    def read(self, now_ns: int, most: int) -> tuple[list[Arrival], bool]:
        """Read frames by `recvmsg`, each with the time-stamp that python-can has requested for the socket."""
        found: list[Arrival] = []
        times, receive, thinning = self._times, self._raw.recvmsg, self._thinning
        times.look()
        for _ in range(most):
            try:
                record, ancillary, _, _ = receive(_CAN_FRAME.size, _ANCILLARY_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                times.found_empty()
                return found, False
            can_id, length, data = _CAN_FRAME.unpack(record)
            if thinning is not None and can_id <= STANDARD_MASK and thinning.drops(can_id, data[:length], now_ns):
                continue
            found.append(Arrival(now_ns - self._age_ns(ancillary), _frame(can_id, data[:length])))
        return found, True

    def _age_ns(self, ancillary: list[tuple[int, int, bytes]]) -> int:
        if not ancillary:
            return 0
        seconds, nanoseconds = _TIMESPEC.unpack_from(ancillary[0][2])
        return self._times.age_of(seconds * _NS_PER_S + nanoseconds)

    def send(self, frame: Frame, haste: Haste) -> None:  # noqa: ARG002 - the kernel sends at once
        """Send by the raw socket."""
        can_id = frame.can_id | (_EXTENDED if frame.extended else 0) | (_REMOTE if frame.remote else 0)
        self._raw.send(_CAN_FRAME.pack(can_id, len(frame.data), frame.data), socket.MSG_DONTWAIT)

    def flush(self) -> None:
        """Do nothing: each frame goes at once."""

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Do nothing: the one frame that the controller has is sent."""

    def want_echo(self) -> None:
        """Do nothing: an echo comes as soon as it can."""

    def thin(self, group: Thinned) -> None:
        """Drop from now on what `group` does not need."""
        self._thinning = Thinning(group)


def _frame(can_id: int, data: bytes) -> Frame:
    if can_id & _ERROR:
        return Frame(can_id & EXTENDED_MASK, data, error=True)
    remote = bool(can_id & _REMOTE)
    if can_id & _EXTENDED:
        return Frame(can_id & EXTENDED_MASK, b"" if remote else data, extended=True, remote=remote)
    return Frame(can_id & STANDARD_MASK, b"" if remote else data, remote=remote)


def port_of(bus: can.BusABC, *, has_nothing_left: Callable[[], bool], noise: Callable[[], None]) -> FramePort:
    """Return the port of an open bus; the arguments are those of `MessagePort`."""
    own: Callable[[], FramePort] | None = getattr(bus, "frame_port", None)
    if own is not None:
        return own()
    raw = getattr(bus, "socket", None)
    kind = bus.channel_info.partition(" ")[0]
    if kind == "socketcan" and isinstance(raw, socket.socket) and raw.family == socket.AF_CAN:
        return SocketCanPort(raw)
    return MessagePort(bus, is_well_known=kind in WELL_KNOWN, has_nothing_left=has_nothing_left, noise=noise)
