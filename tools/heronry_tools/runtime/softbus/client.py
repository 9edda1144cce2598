"""The python-can interface `softbus`: `can.Bus(interface="softbus", channel=NAME)`; NAME may be a path (`place`).

This file decides nothing; it maps python-can's calls to the two sockets of `protocol.py`.

*Sending.* The transmit mailbox holds one frame. While the frame before is still contending for the bus, `send` waits,
up to its time-out. It returns once its own frame is in the mailbox. A sender that keeps its own priority queue opens
the bus with `receive_own_messages=True`. It sends the next frame when the echo of the last one comes in, as it does on
SocketCAN; the mailbox is empty by then. The acceptance filters also apply to echoes, as on SocketCAN. A caller should
recognize an echo by its identifier and data, and not by `is_rx`. Here `is_rx` is False for exactly the own frames, but
SocketCAN in python-can 4.6.1 sets it to False for every frame from the same host.

*Receiving.* Filters act in the hub. A timestamp is the time at which the frame ended on the bus, on the clock of
`time.time()`; changes of that clock since the start of the hub are left out. `StampedMessage` has the same moment in
CLOCK_MONOTONIC, which cannot be set. `fileno()` is readable when a frame waits, and when the hub has ended. One thread
may receive while others send.

*Errors.* Without a hub, with another bit rate, or for CAN FD, the constructor raises CanInitializationError. If the hub
ends, CanOperationError is raised by a call that waits, and by the next call. A reader that is too slow loses the newest
frames; `statistics()` counts the lost frames.
"""

import os
import socket
import struct
from contextlib import ExitStack, suppress

from heronry_tools.console.bus_flags import SOFTWARE_BUS
from heronry_tools.runtime.softbus.batches import Batches
from heronry_tools.runtime.softbus.link import Link, deadline_after, read_record
from heronry_tools.runtime.softbus.place import BusNameError, how_to_start, path_to_call
from heronry_tools.runtime.softbus.protocol import (
    PROTOCOL_VERSION,
    RECORD_BYTES,
    BusStatistics,
    decode_frame,
    decode_statistics,
)
from heronry_wire.arrival_times import StampedMessage
from heronry_wire.bare_can import can
from heronry_wire.frame import EXTENDED_MASK, MAX_DATA_BYTES, STANDARD_MASK, Frame, Malformed
from heronry_wire.runtime_folder import RuntimeFolderError

_CONNECT_TIMEOUT_S = 5
_LINGER_S = 1.0


class SoftBus(can.BusABC):
    """A python-can bus on the hub at `channel`: the name of the bus, or the path of its UNIX socket.

    `bitrate` may be left out; if given, it must be that of the hub. Raises CanInitializationError if the bus cannot be
    opened; the message says what to do.
    """

    def __init__(
        self,
        channel: str | None = None,
        can_filters: can.typechecking.CanFilters | None = None,
        bitrate: int | None = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        **kwargs: object,
    ) -> None:
        if not channel:
            raise can.CanInitializationError(
                f"softbus needs a channel, for example -c {SOFTWARE_BUS}: the name of a bus, or a path"
            )
        if fd:
            reason = f"{channel}: a software bus carries classical CAN, not CAN FD; leave fd out"
            raise can.CanInitializationError(reason)
        self._path = os.fspath(channel)
        self._batches: Batches | None = None
        self.channel_info = f"softbus {self._path}"
        self._link, self._receive, self._day_offset_ns = _connect(self._path, bitrate, wants_own=receive_own_messages)
        try:
            super().__init__(channel, can_filters, **kwargs)
        except BaseException:
            self._close()
            raise

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Wait until the transmit mailbox is empty, and then put a frame into it.

        timeout: the longest wait in s; None: no limit.
        Raises CanOperationError if the mailbox is still full after this time, if another thread is still waiting to
        send, or if the hub is gone. Raises ValueError for a message that is no classical CAN frame.
        """
        self._link.offer(_checked_frame(msg), msg.dlc, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        record = read_record(self._receive, RECORD_BYTES, self._path, deadline_after(timeout))
        return None if record is None else self._from_bus(record), True

    def _apply_filters(self, filters: can.typechecking.CanFilters | None) -> None:
        content = None if filters is None else [[f["can_id"], f["can_mask"], f.get("extended")] for f in filters]
        self._link.ask({"do": "filters", "filters": content})

    def statistics(self) -> BusStatistics:
        """Read the hub's counters: bus load, frames, and what each client sent, received and lost."""
        return decode_statistics(self._link.ask({"do": "statistics"}))

    def disturb(self, *, slowdown: int = 1, loss_per_mille: int = 0) -> None:
        """Slow the bus down and lose frames, as a radio does, for all clients until the next call of this method.

        Without arguments the bus is as good as a wire again.

        slowdown: how many times as long as on a wire a frame takes (1 or more).
        loss_per_mille: how many of 1000 frames each receiver misses.
        """
        self._link.ask({"do": "disturb", "slowdown": slowdown, "loss": loss_per_mille})

    def frame_port(self) -> Batches:
        """Return the port by which a node reads and sends from now on; then `recv` and `send` must not be called."""
        self._batches = Batches(self._link, self._receive, self._path)
        return self._batches

    def fileno(self) -> int:
        """Return the descriptor that is readable when `recv` can return a frame or raise."""
        return self._receive.fileno()

    def shutdown(self) -> None:
        """Leave the bus; before that, wait up to a second until the frame in the mailbox has been sent."""
        if self._is_shutdown:
            return
        super().shutdown()
        with suppress(can.CanOperationError):
            if self._batches is None:
                self._link.linger(_LINGER_S)
            else:
                self._batches.linger(_LINGER_S)
        self._close()

    def _close(self) -> None:
        self._link.close()
        self._receive.close()

    def _from_bus(self, record: bytes) -> can.Message:
        received = decode_frame(record)
        if isinstance(received, Malformed):
            raise can.CanOperationError(
                f"{self._path}: what the bus sent is no frame of this version of heronry ({received.reason}); start "
                "the bus again with this version"
            )
        frame = received.frame
        return StampedMessage(
            received.time_ns,
            timestamp=(received.time_ns + self._day_offset_ns) / 1e9,
            arbitration_id=frame.can_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            channel=self._path,
            dlc=received.dlc,
            data=frame.data,
            is_rx=not received.own,
        )

    @staticmethod
    def _detect_available_configs() -> list[can.typechecking.AutoDetectedConfig]:
        """Return nothing: a bus can be at any path, so it cannot be detected."""
        return []


def _checked_frame(msg: can.Message) -> Frame:
    if msg.is_fd or msg.is_error_frame:
        raise ValueError("a software bus carries data and remote frames, neither CAN FD nor error frames")
    if not 0 <= msg.arbitration_id <= (EXTENDED_MASK if msg.is_extended_id else STANDARD_MASK):
        bits = 29 if msg.is_extended_id else 11
        raise ValueError(f"identifier {msg.arbitration_id:#x} does not fit into {bits} bits")
    if not 0 <= msg.dlc <= MAX_DATA_BYTES or (not msg.is_remote_frame and msg.dlc != len(msg.data)):
        raise ValueError(
            f"a frame with dlc {msg.dlc} and {len(msg.data)} bytes of data cannot be sent: give at most "
            f"{MAX_DATA_BYTES} bytes, and as dlc the number of bytes (a remote frame has no bytes, and a dlc of at "
            f"most {MAX_DATA_BYTES})"
        )
    data = b"" if msg.is_remote_frame else bytes(msg.data)
    return Frame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame)


def _connect(path: str, bitrate: int | None, *, wants_own: bool) -> tuple[Link, socket.socket, int]:
    with ExitStack() as undo:
        command = undo.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
        receive, hub_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        undo.enter_context(receive)
        with hub_end:
            try:
                # A socket with a time-out of Python's does not wait for its turn to be accepted; this one does.
                command.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", _CONNECT_TIMEOUT_S, 0))
                command.connect(os.fspath(path_to_call(path)))
                link = Link(command, path)
                hello = {"do": "hello", "protocol": PROTOCOL_VERSION, "own": wants_own}
                answer = link.ask(hello, hub_end)
                hub_bitrate, day_offset_ns = answer["bitrate"], int(answer["day_offset_ns"])
            except (can.CanOperationError, BusNameError, RuntimeFolderError) as error:
                raise can.CanInitializationError(str(error)) from error
            except OSError as error:
                reason = f"{path}: no bus answers there ({error.strerror or error}); {how_to_start(path)}"
                raise can.CanInitializationError(reason) from error
        if bitrate not in {None, hub_bitrate}:
            remedy = f"serve it with -b {bitrate}, or change the bit rate of the spec, or of -b"
            raise can.CanInitializationError(f"{path}: the bus runs at {hub_bitrate} bit/s, not at {bitrate}; {remedy}")
        receive.setblocking(False)
        undo.pop_all()
    return link, receive, day_offset_ns
