"""One bus of one node: frames in and out of python-can, one frame in flight at a time (design rule 13).

A frame that was handed over is *in flight* until its echo comes back: the bus is opened with `receive_own_messages`,
and the echo is known by its identifier and bytes (on one host SocketCAN marks everybody's frames as "not received").
Only then does the next most urgent one follow, so that what becomes urgent meanwhile goes first. An echo that does not
come within `ECHO_TIMEOUT_NS` (bus-off, an overrun of the receive queue) is given up and counted.

A driver asked to send while the controller's own queue is full (ENOBUFS, a busy mailbox) is tried again a millisecond
later. Anything else that goes wrong with the bus raises LinkError with one sentence: no agent flies on a dead link.

Interfaces that cannot echo are driven without: there a frame counts as sent when `send` returns.
"""

import errno
from collections.abc import Mapping
from typing import Any

import can

from heronry_wire.errors import HeronryError
from heronry_wire.frame import Frame
from heronry_wire.transmit_queue import TransmitQueue

ECHO_TIMEOUT_NS = 100_000_000
RETRY_NS = 1_000_000
_ECHOING = ("socketcan", "softbus", "virtual")
_BURST = 64  # frames taken in one turn: a flood must not starve the timers


class LinkError(HeronryError):
    """The bus cannot be used; the message is one sentence with a remedy where there is one."""


class Link:
    """A python-can bus with a queue in front of it."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        """Open the bus that python-can's keyword arguments `config` describe; raises LinkError."""
        self.name = f"{config.get('interface') or 'the configured interface'} {config.get('channel') or ''}".strip()
        self.echoes_lost = 0
        self.queue = TransmitQueue()
        self._in_flight: Frame | None = None
        self._deadline_ns: int | None = None  # of the echo, or of the next try
        try:
            self._bus = can.Bus(**{**config, "receive_own_messages": True})
        except (can.CanError, OSError, ValueError, ImportError) as error:
            raise LinkError(f"{self.name} cannot be opened: {_sentence(error)}") from error
        self._echoes = self._bus.channel_info.lower().startswith(_ECHOING)

    def fileno(self) -> int:
        """Descriptor that is readable when `receive` has something."""
        return self._bus.fileno()

    def send(self, frame: Frame, now_ns: int) -> None:
        """Queue a frame; it goes out when it is the most urgent one and the bus is free."""
        self.queue.push(frame)
        self.pump(now_ns)

    def receive(self, now_ns: int) -> list[Frame]:
        """Take what has arrived, without waiting; own echoes are taken out."""
        frames = []
        try:
            for _ in range(_BURST):
                message = self._bus.recv(0)
                if message is None:
                    break
                frame = _frame_of(message)
                if frame == self._in_flight:
                    self._in_flight = None
                    self.pump(now_ns)
                else:
                    frames.append(frame)
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name} is lost: {_sentence(error)}") from error
        return frames

    def pump(self, now_ns: int) -> None:
        """Hand over the next frame if none is in flight; also to be called when `next_deadline_ns` has come."""
        if self._in_flight is not None:
            if self._deadline_ns is not None and now_ns < self._deadline_ns:
                return
            self._in_flight = None
            self.echoes_lost += 1
        elif self._deadline_ns is not None and now_ns < self._deadline_ns:
            return
        self._deadline_ns = None
        while len(self.queue) and self._hand_over(self.queue.pop(), now_ns):
            pass

    def next_deadline_ns(self) -> int | None:
        """When to call `pump` at the latest."""
        return self._deadline_ns

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()

    def _hand_over(self, frame: Frame, now_ns: int) -> bool:
        """Send one frame; tells whether the next one may follow at once."""
        message = can.Message(
            arbitration_id=frame.can_id, is_extended_id=frame.extended, is_remote_frame=frame.remote, data=frame.data
        )
        try:
            self._bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            if not _is_full(error):
                raise LinkError(f"{self.name} is lost: {_sentence(error)}") from error
            self.queue.push(frame)
            self._deadline_ns = now_ns + RETRY_NS
            return False
        if self._echoes:
            self._in_flight, self._deadline_ns = frame, now_ns + ECHO_TIMEOUT_NS
        return not self._echoes


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
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code in (errno.ENOBUFS, errno.EAGAIN)


_REMEDIES = {
    errno.EAFNOSUPPORT: "this kernel has no SocketCAN; load it, or run the command under tools/with-vcan",
    errno.ENODEV: "there is no such interface; 'ip link' lists them",
    errno.ENETDOWN: "the interface is down; 'ip link set up' brings it up",
}


def _sentence(error: BaseException) -> str:
    """What went wrong, in one line, with the remedy where it is known."""
    code = getattr(error, "errno", None) or getattr(error, "error_code", None)
    if code in _REMEDIES:
        return _REMEDIES[code]
    text = str(error).strip()
    return text.splitlines()[0].rstrip(".") if text else type(error).__name__
