"""The SDO client that writes one value into one node by block transfer (CiA 301, 7.2.4.3.10 and following).

opened    the transfer was requested. The answer gives the number of segments in a block
sending   the segments of a block go out, one per `segment_ns`; then the node acknowledges how many came in order.
          The next block begins after these, so segments that were lost are sent again. Where this computer was late, or
          the acknowledgement, the segments that are due follow at once, up to LATE_NS of them: else each wake-up that
          comes a little late would lengthen the transfer
ended     all segments have been acknowledged, and the checksum was sent. The node takes the value, or aborts
taken, failed    the transfer is over; `why` says why it failed

lost segment          the node's acknowledgement names the last segment in order
lost acknowledgement  the transfer fails after SILENCE_NS
doubled, late or      ends the transfer with an abort if it does not fit. The checksum, and the seal of a
forged answer         sealed value, keep a wrong value from being taken
no progress           after MOST_EMPTY acknowledgements in a row that name no segment the transfer fails
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from heronry_wire.sansio import NEVER_NS
from heronry_wire.sdo import (
    ABORT,
    BLOCK_ACKNOWLEDGE,
    BLOCK_CRC,
    BLOCK_DOWNLOAD,
    BLOCK_DOWNLOAD_ANSWER,
    BLOCK_END,
    BLOCK_INITIATE,
    BLOCK_LAST_SEGMENT,
    BLOCK_PART_BITS,
    BLOCK_SIZE_GIVEN,
    COMMAND_BITS,
    LATE_NS,
    MESSAGE_BYTES,
    MOST_SEGMENTS,
    SEGMENT_BYTES,
    Abort,
    abort_message,
    block_acknowledged,
    block_end,
    block_size,
    command_of,
    crc,
    read_head,
    read_length,
    segment,
    with_number,
)

SILENCE_NS = 1_000_000_000
"""The longest wait for one answer, in ns: a node drops its client after that time."""

MOST_EMPTY = 3


class Outcome(Enum):
    """What has become of a transfer."""

    UNDER_WAY = auto()
    TAKEN = auto()
    LOCKED = auto()  # the node does not take this value in its present state
    REFUSED = auto()  # the node has read the value, and does not want it
    FAILED = auto()  # the transfer itself did not succeed


@dataclass(slots=True)
class BlockDownload:
    """One transfer; `next_ns` is the time in ns at which to call `tick`.

    index, sub_index: the place of the object.
    content: the value to write, at least one byte.
    segment_ns: time from one segment to the next, in ns.
    say: is called with each request to send to the node.
    """

    index: int
    content: bytes
    segment_ns: int
    say: Callable[[bytes], None]
    outcome: Outcome = Outcome.UNDER_WAY
    why: str = ""
    sub_index: int = 0
    next_ns: int = NEVER_NS
    _size: int = 0  # of a block, in segments; 0: the transfer is not open yet
    _at: int = 0  # index in `content` at which the present block begins
    _sent: int = 0  # segments of the present block
    _due_ns: int = 0  # when the next segment is to be sent, by its pace
    _empty: int = 0  # acknowledgements in a row that named no segment
    _is_ended: bool = False

    def begin(self, now_ns: int) -> None:
        """Request the transfer."""
        self._ask(
            with_number(BLOCK_DOWNLOAD | BLOCK_CRC | BLOCK_SIZE_GIVEN, self.index, self.sub_index, len(self.content)),
            now_ns,
        )

    def heard(self, message: bytes, now_ns: int) -> None:
        """Process an answer of the node."""
        if len(message) != MESSAGE_BYTES:
            self._does_not_fit()
            return
        command = command_of(message)
        part = command & BLOCK_PART_BITS
        if command & COMMAND_BITS == ABORT:
            self._aborted(read_length(read_head(message)[2]))
        elif command & COMMAND_BITS != BLOCK_DOWNLOAD_ANSWER:
            self._does_not_fit()
        elif part == BLOCK_INITIATE and not self._size:
            self._open(block_size(read_head(message)[2]), now_ns)
        elif part == BLOCK_ACKNOWLEDGE and self._size and not self._is_ended:
            self._acknowledged(*block_acknowledged(message), now_ns)
        elif part == BLOCK_END and self._is_ended:
            self.outcome, self.next_ns = Outcome.TAKEN, NEVER_NS
        else:
            self._does_not_fit()

    def tick(self, now_ns: int) -> None:
        """Send the segment that is due, or end a transfer whose answer has not come within SILENCE_NS."""
        if now_ns < self.next_ns:
            return
        if self._size and not self._is_ended and not self._is_block_sent():
            self._send_segment(now_ns)
        else:
            self._fail(Outcome.FAILED, "it did not answer")

    def put_off(self, until_ns: int) -> None:
        """Send no segment before `until_ns`; a wait for an answer goes on."""
        if self._size and not self._is_ended and not self._is_block_sent():
            self.next_ns = max(self.next_ns, until_ns)

    def stop(self) -> None:
        """Abort the transfer, since the node needs the value no more."""
        self.say(abort_message(self.index, self.sub_index, Abort.DEVICE_STATE))
        self._fail(Outcome.FAILED, "it is needed no more")

    def _open(self, size: int, now_ns: int) -> None:
        if not 1 <= size <= MOST_SEGMENTS:
            self._does_not_fit()
            return
        self._size, self._due_ns = size, now_ns
        self._send_segment(now_ns)

    def _send_segment(self, now_ns: int) -> None:
        begin = self._at + self._sent * SEGMENT_BYTES
        self._sent += 1
        self._due_ns = max(self._due_ns, now_ns - LATE_NS) + self.segment_ns
        is_last = begin + SEGMENT_BYTES >= len(self.content)
        command = self._sent | (BLOCK_LAST_SEGMENT if is_last else 0)
        self.say(segment(command, self.content[begin : begin + SEGMENT_BYTES]))
        self.next_ns = now_ns + SILENCE_NS if self._is_block_sent() else self._due_ns

    def _is_block_sent(self) -> bool:
        return self._sent == self._size or self._at + self._sent * SEGMENT_BYTES >= len(self.content)

    def _acknowledged(self, received: int, size: int, now_ns: int) -> None:
        if received > self._sent or not 1 <= size <= MOST_SEGMENTS:
            self._does_not_fit()
            return
        self._empty = 0 if received else self._empty + 1
        if self._empty > MOST_EMPTY:
            self._fail(Outcome.FAILED, "it received nothing")
            return
        self._at += received * SEGMENT_BYTES
        self._sent, self._size = 0, size
        if self._at < len(self.content):
            self.next_ns = self._due_ns
            return
        self._is_ended = True
        unused = self._at - len(self.content)
        self._ask(block_end(BLOCK_DOWNLOAD | BLOCK_END | unused << 2, crc(self.content)), now_ns)

    def _ask(self, message: bytes, now_ns: int) -> None:
        self.say(message)
        self.next_ns = now_ns + SILENCE_NS

    def _aborted(self, code: int) -> None:
        if code == Abort.DEVICE_STATE.value:
            self._fail(Outcome.LOCKED, "it does not take it now")
        elif code == Abort.VALUE.value:
            self._fail(Outcome.REFUSED, "it refuses it: its log says why")
        else:
            self._fail(Outcome.FAILED, f"it aborts with code {code:08X}h")

    def _does_not_fit(self) -> None:
        # else the node takes the next request for a segment
        self.say(abort_message(self.index, self.sub_index, Abort.COMMAND))
        self._fail(Outcome.FAILED, "an answer did not fit")

    def _fail(self, outcome: Outcome, why: str) -> None:
        self.outcome, self.why, self.next_ns = outcome, why, NEVER_NS
