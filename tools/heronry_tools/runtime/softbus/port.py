"""One client as the hub sees it: its two sockets, its acceptance filters, its bounded receive queue.

The port decides which frames its client gets. It ensures that a client which does not read delays no other client: the
kernel buffers a few hundred frames for the client, and the port some thousands more. If both buffers are full, new
frames are dropped and counted, as in an overrun of a controller. The echo of a client with batches is never dropped,
since it tells the client that a mailbox is empty.

A port has four states, in this order:

    unknown          the hello of the client, which brings the receive socket, has not come
    without frames   the client has not set its filters yet, so it gets no frame
    joined           the client gets the frames that its filters accept
    gone             a call on a socket of the port has failed: the port waits for the hub to remove it
"""

import socket
import struct
from collections import deque
from itertools import islice

from heronry_tools.runtime.softbus.protocol import (
    BATCH_RECORDS,
    DONE,
    MAILBOXES,
    MAX_COMMAND_BYTES,
    AcceptanceFilter,
    ClientStatistics,
    Fate,
    encode_command,
    encode_received,
)
from heronry_wire.frame import Frame
from heronry_wire.thinning import Thinned, Thinning

RECEIVE_QUEUE_FRAMES = 4096
"""Half a second at 1 Mbit/s and full load: longer than a busy machine delays a client that reads."""

_MAX_REMEMBERED_VERDICTS = 4096
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid


class Port:
    """The hub's side of one client. `number` is never used twice in the life of a hub."""

    def __init__(self, number: int, command: socket.socket) -> None:
        command.setblocking(False)
        self.number = number
        self.command = command
        self.receive: socket.socket | None = None
        self.offered = 0  # frames in its mailboxes
        self.gone = False
        self.batched = False
        self.queue: deque[bytes] = deque()
        self._thinning: Thinning | None = None
        self._wants_own = False
        self._filters: tuple[AcceptanceFilter, ...] | None = ()
        self._verdicts: dict[tuple[int, bool], bool] = {}
        credentials = command.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        self._pid = _CREDENTIALS.unpack(credentials)[0]
        self._sent = 0
        self._received = 0
        self._overruns = 0

    def fileno(self) -> int:
        """Return the descriptor of the client's receive socket; -1 until the client has sent this socket.

        While the socket is full, `select` waits on this descriptor until the socket takes frames again.
        """
        return -1 if self.receive is None else self.receive.fileno()

    def read(self) -> tuple[bytes, list[int]]:
        """Read one record and the descriptors that came with it.

        Both are empty if no record waits or the client is gone.
        """
        record = b""
        descriptors: list[int] = []
        try:
            if self.receive is not None:
                record = self.command.recv(MAX_COMMAND_BYTES)
            else:
                record, descriptors, _, _ = socket.recv_fds(self.command, MAX_COMMAND_BYTES, 1)
        except BlockingIOError:
            return b"", []
        except OSError:
            pass
        self.gone = self.gone or not record
        return record, descriptors

    def answer(self, record: bytes) -> None:
        """Send a record on the command socket; a client that does not read its answers counts as gone."""
        try:
            self.command.send(record)
        except OSError:
            self.gone = True

    def refuse(self, reason: str) -> None:
        """Tell the client why it is being removed."""
        self.answer(encode_command({"refused": reason}))
        self.gone = True

    def join(self, receive_fd: int, *, wants_own: bool) -> bool:
        """Take the receive socket that came with the client's hello; returns False if the descriptor is no socket.

        wants_own: whether the client also receives the frames that it has sent itself.
        """
        try:
            self.receive = socket.socket(fileno=receive_fd)
        except OSError:
            return False
        self.receive.setblocking(False)
        self._wants_own = wants_own
        return True

    def set_filters(self, filters: tuple[AcceptanceFilter, ...] | None) -> None:
        """From now on deliver only frames that pass at least one filter; None delivers every frame."""
        self._filters = filters
        self._verdicts.clear()

    def accepts(self, can_id: int, *, extended: bool) -> bool:
        """Tell whether the filters of this client accept a frame with this identifier.

        The answer is remembered for the next frame with this identifier, since there can be many filters.
        """
        verdict = self._verdicts.get((can_id, extended))
        if verdict is None:
            if len(self._verdicts) >= _MAX_REMEMBERED_VERDICTS:
                self._verdicts.clear()
            verdict = self._filters is None or any(f.accepts(can_id, extended=extended) for f in self._filters)
            self._verdicts[can_id, extended] = verdict
        return verdict

    def thin(self, group: Thinned) -> None:
        """From now on deliver only what `group` needs of its identifiers."""
        self._thinning = Thinning(group)

    def thins(self, can_id: int) -> bool:
        """Tell whether `drops` must be asked about frames with this 11-bit identifier."""
        return self._thinning is not None and self._thinning.concerns(can_id)

    def drops(self, frame: Frame, end_ns: int) -> bool:
        """Tell whether the client does not need this 11-bit frame, because its group is thinned."""
        return self._thinning is not None and self._thinning.drops(frame.can_id, frame.data, end_ns)

    def confirm(self, frame: Frame, dlc: int, end_ns: int) -> None:
        """Tell the client that the frame it sent has left the bus.

        The frame is also echoed to the client, if the client wants echoes and its filters accept the frame. With
        batches the echo itself tells it.
        """
        self.offered -= 1
        self._sent += 1
        if self.batched:
            self.queue.append(encode_received(frame, dlc, end_ns, Fate.SENT))
            return
        self.answer(DONE)
        if self._wants_own and self.accepts(frame.can_id, extended=frame.extended):
            self.deliver(encode_received(frame, dlc, end_ns, Fate.SENT))

    def withdrawn(self, frame: Frame, dlc: int, now_ns: int) -> None:
        """Tell the client that a frame that it has offered is taken back."""
        self.offered -= 1
        self.queue.append(encode_received(frame, dlc, now_ns, Fate.WITHDRAWN))

    @property
    def has_room(self) -> bool:
        """Tell whether the client may offer a frame."""
        return self.offered < (MAILBOXES if self.batched else 1)

    def deliver(self, record: bytes) -> None:
        """Queue a received frame for the next `flush`; drop it if the queue is full."""
        if len(self.queue) >= RECEIVE_QUEUE_FRAMES:
            self._overruns += 1
        else:
            self.queue.append(record)

    def flush(self) -> None:
        """Pass on what waits in the queue, as far as the client's socket takes it."""
        queue = self.queue
        while queue:
            count = min(len(queue), BATCH_RECORDS) if self.batched else 1
            if not self._hand_over(queue[0] if count == 1 else b"".join(islice(queue, count)), count):
                return
            if count == len(queue):
                queue.clear()
            else:
                for _ in range(count):
                    queue.popleft()

    def _hand_over(self, packet: bytes, count: int) -> bool:
        if self.receive is None:
            return True
        try:
            self.receive.send(packet)
        except BlockingIOError:
            return False
        except OSError:
            self.gone = True
            return True
        self._received += count
        return True

    def statistics(self) -> ClientStatistics:
        """Return the counters of this client."""
        return ClientStatistics(self.number, self._pid, self._sent, self._received, self._overruns)

    def close(self) -> None:
        """Close both sockets."""
        self.command.close()
        if self.receive is not None:
            self.receive.close()
