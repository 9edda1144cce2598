"""Collects the next configuration of a PE from PREPARE and SLICE frames, checks it, and stages it.

The *head* of a slice gives its length and its digest; its *body* is the slice itself, in frames of five bytes.

    nothing      no PREPARE has been accepted, or the last one was refused
    collecting   PREPARE has named an epoch. The head and the body of this PE's slice come in any order, and some frames
                 may be doubled or missing
    staged       the slice is complete, has the digest of its head, and this PE can run it

A newer epoch, or an epoch of a higher term, replaces what was collected or staged. A repeated command for a staged
epoch is answered again and changes nothing. In two cases a slice is complete without frames of a body:

- PREPARE names a contingency on board. If the contingency is not on board, the PE requests its slice (NOT_ON_BOARD).
- The head announces the slice that already runs on this PE.

If frames of the body are missing, and none has come for half a heartbeat period, the PE answers INCOMPLETE.

The PE answers by page 1 of its state; the methods that take commands return whether an answer is due now. Page 1 names
the epoch of the last PREPARE, so that the manager can tell which command is answered. If this epoch is staged, page 1
gives its digest, and otherwise the reason why it is not staged. A PREPARE of an old epoch is answered with STALE_EPOCH:
older than the epoch that runs or, in the same term, than the epoch that is collected or staged.

After a pause of the process, the frames that have come meanwhile are handled in their order. After a restart the PE is
unconfigured, and the manager begins anew.
"""

from dataclasses import dataclass

from heronry_agent.core.configuration.slice_reading import SliceReader
from heronry_agent.core.table_index import TableIndex
from heronry_wire.capacities import MOST_SLICE_BYTES
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import NO_EPOCH, SLICE_BYTES_PER_FRAME, Prepare, SliceBody, SliceHead, is_newer
from heronry_wire.sansio import NEVER_NS
from heronry_wire.state_frames import Reason


@dataclass(frozen=True, slots=True)
class Configured:
    """One PE's part of a configuration.

    epoch: number of the configuration.
    digest: digest of the whole configuration.
    slice_digest, length: digest of the PE's slice, and its length in bytes.
    table: the table beside, if this configuration is of it (`table_change`); None: it is of the table that flies.
    """

    epoch: int
    digest: int
    slice: Slice
    slice_digest: int
    length: int
    table: TableIndex | None = None


UNCONFIGURED = Configured(NO_EPOCH, 0, Slice(), 0, 0)


@dataclass(slots=True)
class _Collection:
    """The received parts of the slice of a new epoch: its PREPARE, its head, and frames of its body by number."""

    prepare: Prepare
    head: SliceHead | None = None
    bodies: dict[int, bytes] | None = None

    def missing(self) -> bool:
        """Tell whether any frame of the body has not come; call this only when the head has come."""
        assert self.head is not None
        held = self.bodies or {}
        return any(index not in held for index in range(1, _frames(self.head.length) + 1))

    def body(self) -> bytes:
        """Join the frames of the body to the bytes of the slice; call this only when all have come."""
        assert self.head is not None
        held = self.bodies or {}
        joined = b"".join(held[index] for index in range(1, _frames(self.head.length) + 1))
        return joined[: self.head.length]


def _frames(length: int) -> int:
    return -(-length // SLICE_BYTES_PER_FRAME)


class Staging:
    """Collects and stages the slices of one PE; methods that return bool tell whether page 1 is to be sent now."""

    def __init__(self, reader: SliceReader, quiet_ns: int) -> None:
        """Begin unconfigured.

        quiet_ns: if frames of a slice are missing, and none has come for this time in ns, INCOMPLETE is reported.
        """
        self.reader = reader
        self.beside: SliceReader | None = None  # of the table beside, while there is one
        self._quiet_ns = quiet_ns
        self._collection: _Collection | None = None
        self._term = 0  # term of the last PREPARE that was accepted
        self.staged = UNCONFIGURED  # kept after its steps are taken: page 1 names it until the next PREPARE
        self.reason = Reason.NONE
        self.ask_ns = NEVER_NS  # when to report INCOMPLETE

    def prepare(self, command: Prepare, running: Configured) -> bool:
        """Begin to collect the slice of the epoch that a PREPARE names; tells whether page 1 is to be sent now.

        If the contingency of the PREPARE is on board, its slice is staged at once. A PREPARE of the epoch that is
        staged or runs here is only answered.

        running: the configuration that runs here; a PREPARE of an older epoch is refused.
        """
        epoch = command.epoch
        if (epoch, command.digest) in ((self.staged.epoch, self.staged.digest), (running.epoch, running.digest)):
            self.reason = Reason.NONE
            return True
        newest = self._newest()
        if newest is not None and (newest.epoch, newest.digest) == (epoch, command.digest):
            return self.reason is Reason.NOT_ON_BOARD
        if not is_newer(epoch, running.epoch) or self._is_superseded(command):
            return self.refuse(Reason.STALE_EPOCH)
        self._drop()
        self.staged = running
        self._term = command.term
        self.reason = Reason.NONE
        self._collection = _Collection(command)
        return command.contingency != 0 and self._take_from_board(command)

    def _take_from_board(self, command: Prepare) -> bool:
        """Stage the slice of the contingency that a PREPARE names, or refuse the PREPARE with a reason.

        The reason is NOT_ON_BOARD if the slice is not on board. Tells whether page 1 is to be sent now.
        """
        collection, found = self._collection, self.reader.on_board(command.contingency, command.digest)
        assert collection is not None
        if found is None:
            return self.refuse(Reason.NOT_ON_BOARD)
        body, digest = found
        collection.head = SliceHead(0, command.epoch & 0xFF, len(body), digest)
        read = self.reader.read(body, digest)
        return self._stage(read) if isinstance(read, Slice) else self.refuse(read)

    def head(self, command: SliceHead, running: Configured, now_ns: int) -> bool:
        """Take the head of this PE's slice; tells whether page 1 is to be sent now.

        running: the configuration that runs here. If the head announces the slice of this configuration, that slice
            is staged at once.
        """
        collection = self._collection
        if collection is None or not self._is_about(command.epoch_low, collection.prepare.epoch):
            return self._is_about(command.epoch_low, self.staged.epoch)
        if command.length > MOST_SLICE_BYTES:
            return self.refuse(Reason.UNKNOWN_INDEX)
        if collection.head is not None and collection.head != command:
            collection.bodies = None
        collection.head = command
        if running.epoch != NO_EPOCH and (command.digest, command.length) == (running.slice_digest, running.length):
            return self._stage(running.slice)
        return self._check(now_ns)

    def body(self, command: SliceBody, now_ns: int) -> bool:
        """Take one frame of the body of this PE's slice; returns True if page 1 is to be sent now."""
        collection = self._collection
        if collection is None or not self._is_about(command.epoch_low, collection.prepare.epoch):
            return False
        if collection.bodies is None:
            collection.bodies = {}
        collection.bodies[command.index] = command.body
        return collection.head is not None and self._check(now_ns)

    def tick(self, now_ns: int) -> bool:
        """Report INCOMPLETE in page 1 if frames of the body of this PE's slice are missing and have stopped coming.

        Returns True if page 1 is to be sent now.
        """
        if now_ns < self.ask_ns:
            return False
        self.ask_ns = NEVER_NS
        return self.refuse(Reason.INCOMPLETE)

    def refuse(self, reason: Reason) -> bool:
        """Set the reason that page 1 gives for a refused command; returns True, since page 1 is due."""
        self.reason = reason
        return True

    @property
    def told(self) -> tuple[int, int]:
        """The epoch and the digest that page 1 shows.

        While a slice is being collected, these are the epoch of that slice and 0.
        Otherwise they are the epoch and the digest of the staged configuration.
        """
        if self._collection is not None:
            return self._collection.prepare.epoch, 0
        return self.staged.epoch, self.staged.digest

    def put_beside(self, beside: SliceReader | None, running: Configured) -> None:
        """Stage slices of another table, too; what is staged of the table that was beside before is forgotten."""
        self.beside = beside
        if self.staged.table is not None:
            self.staged = running

    def collecting(self) -> bool:
        """Tell whether a slice is being collected."""
        return self._collection is not None

    def _is_about(self, epoch_low: int, epoch: int) -> bool:
        return epoch != NO_EPOCH and epoch_low == epoch & 0xFF

    def _newest(self) -> Prepare | Configured | None:
        """Return the last accepted PREPARE, or the configuration that was staged from it; None before the first one."""
        if self._collection is not None:
            return self._collection.prepare
        return self.staged if self.staged.epoch != NO_EPOCH else None

    def _is_superseded(self, command: Prepare) -> bool:
        """Tell whether a PREPARE of the same term was accepted before, for the same epoch or for a newer epoch."""
        newest = self._newest()
        return newest is not None and command.term == self._term and not is_newer(command.epoch, newest.epoch)

    def _check(self, now_ns: int) -> bool:
        """Stage the collected slice if it is complete and this PE can run it.

        If frames of the slice are missing, wait for them. If this PE cannot run the slice, refuse it.
        """
        collection = self._collection
        assert collection is not None
        assert collection.head is not None
        if collection.missing():
            self.ask_ns = now_ns + self._quiet_ns
            return False
        body, digest, table = collection.body(), collection.head.digest, None
        read = self.reader.read(body, digest)
        if read is Reason.DIGEST and self.beside is not None:  # the digest names the table
            read, table = self.beside.read(body, digest), self.beside.index
        if isinstance(read, Slice):
            return self._stage(read, table)
        collection.bodies, self.ask_ns = None, NEVER_NS
        return self.refuse(read)

    def _stage(self, wanted: Slice, table: TableIndex | None = None) -> bool:
        collection = self._collection
        assert collection is not None
        assert collection.head is not None
        prepare, head = collection.prepare, collection.head
        self.staged = Configured(prepare.epoch, prepare.digest, wanted, head.digest, head.length, table)
        self._drop()
        self.reason = Reason.NONE
        return True

    def _drop(self) -> None:
        self._collection, self.ask_ns = None, NEVER_NS
