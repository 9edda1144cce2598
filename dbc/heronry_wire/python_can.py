"""Converts between python-can and this project, and counts lost frames.

A message of python-can becomes a frame. An exception becomes one sentence: a back-end may raise any exception, for
example its own errors, those of the kernel, or a NameError where its library is missing. Where a remedy is known, the
sentence gives the remedy in place of the exception's text.
"""

import errno
import socket
import struct

from heronry_wire.bare_can import can
from heronry_wire.frame import Frame

_SO_MEMINFO, _MEMINFO_DROPS = 55, 8  # Linux, socket(7): the last of nine counters is frames dropped for want of room
_REMEDIES = {
    errno.EAFNOSUPPORT: "this kernel has no CAN: use a software bus, or run under tools/with-vcan",
    errno.ENODEV: "there is no such interface: 'ip link' lists the interfaces",
    errno.ENETDOWN: "the interface is down: 'ip link set NAME up' brings it up",
}


def frame_of(message: can.Message) -> Frame:
    """Convert a message of python-can to a frame."""
    return Frame(
        message.arbitration_id,
        b"" if message.is_remote_frame else bytes(message.data),
        message.is_extended_id,
        message.is_remote_frame,
        message.is_error_frame,
    )


def message_of(frame: Frame) -> can.Message:
    """Convert a frame to a message that python-can can send."""
    return can.Message(
        arbitration_id=frame.can_id, is_extended_id=frame.extended, is_remote_frame=frame.remote, data=frame.data
    )


def frames_dropped(bus: can.BusABC) -> int:
    """Number of received frames that SocketCAN has dropped since the bus was opened; 0 for other back-ends."""
    raw = getattr(bus, "socket", None)
    if not isinstance(raw, socket.socket):
        return 0
    counters = raw.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 4 * (_MEMINFO_DROPS + 1))
    dropped: int = struct.unpack(f"={_MEMINFO_DROPS + 1}I", counters)[_MEMINFO_DROPS]
    return dropped


def is_full(error: Exception) -> bool:
    """Tell whether a send failed for no other reason than that the controller's queue is full."""
    if isinstance(error, can.CanError) and error.error_code is None:
        return "buffer full" in str(error)  # python-can 4.6 on SocketCAN, when its socket is not writable
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code in (errno.ENOBUFS, errno.EAGAIN)


def sentence_of(error: BaseException) -> str:
    """Describe an error without a full stop: by the remedy if one is known, else by the first line of its text."""
    code = error.errno if isinstance(error, OSError) else getattr(error, "error_code", None)
    if code in _REMEDIES:
        return _REMEDIES[code]
    cause = error.__cause__ if isinstance(error.__cause__, OSError) and not str(error) else error
    return str(cause).strip().splitlines()[0].rstrip(".") if str(cause).strip() else type(error).__name__
