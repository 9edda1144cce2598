"""Collects the next configuration of a PE from PREPARE and SLICE frames, checks it, and stages it.

    nothing      no PREPARE has been accepted, or the last one was refused
    collecting   PREPARE named an epoch; the head and the body of this PE's slice come in any order, some of them
                 perhaps doubled or not at all. A contingency on board is complete immediately; for one that is not on
                 board the PE requests the slice (NOT_ON_BOARD)
    staged       the slice is complete, has its digest, and this PE can run it

A newer epoch, or one from a higher term, replaces what was collected or staged. A repeated command for a staged epoch
is answered again and changes nothing. A head that announces the slice which already runs here stages it at once. For
any other slice the body must follow: if frames are missing and none has come for half a heartbeat period, the PE
answers INCOMPLETE. That also happens if the manager wrongly believes that the slice already runs here, and sends no
body.

An answer is a page 1 of the state; the methods that take commands tell whether an answer is due now. Page 1 names the
epoch of the last PREPARE, so the manager knows which command is answered. Page 1 also gives the digest once the epoch
is staged, and a reason until then. A late PREPARE, of an older epoch than the one collected, is answered with
STALE_EPOCH. After a pause the frames that waited are taken in their order; repetitions by the manager change nothing.
After a restart the PE is unconfigured, and the manager begins anew.
"""

from dataclasses import dataclass

from heronry_agent.core.slice_reading import SliceReader
from heronry_wire.capacities import MOST_SLICE_BYTES
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import NO_EPOCH, SLICE_BYTES_PER_FRAME, Prepare, SliceBody, SliceHead, is_newer
from heronry_wire.sansio import NEVER_NS
from heronry_wire.state_frames import Reason


@dataclass(frozen=True, slots=True)
class Configured:
    """One PE's part of a configuration.

    `digest` is that of the whole configuration, `slice_digest` that of the slice.
    """

    epoch: int
    digest: int
    slice: Slice
    slice_digest: int
    length: int


UNCONFIGURED = Configured(NO_EPOCH, 0, Slice(), 0, 0)


@dataclass(slots=True)
class _Collection:
    """An epoch that is being collected."""

    prepare: Prepare
    head: SliceHead | None = None
    bodies: dict[int, bytes] | None = None

    def missing(self) -> bool:
        """Tell whether a part of the body has not come; the head must have."""
        assert self.head is not None
        held = self.bodies or {}
        return any(index not in held for index in range(1, _frames(self.head.length) + 1))

    def body(self) -> bytes:
        """Give the bytes of the slice; nothing may be missing."""
        assert self.head is not None
        held = self.bodies or {}
        joined = b"".join(held[index] for index in range(1, _frames(self.head.length) + 1))
        return joined[: self.head.length]


def _frames(length: int) -> int:
    return -(-length // SLICE_BYTES_PER_FRAME)


class Staging:
    """Collects and stages the slices of one PE. The methods that take commands tell whether page 1 is due now."""

    def __init__(self, reader: SliceReader, quiet_ns: int) -> None:
        """quiet_ns: how long no frame of an incomplete body may come before the PE reports INCOMPLETE."""
        self.reader = reader
        self._quiet_ns = quiet_ns
        self._collection: _Collection | None = None
        self._term = 0  # term of the last PREPARE that was accepted
        self.staged = UNCONFIGURED  # kept after its steps are taken: page 1 names it until the next PREPARE
        self.reason = Reason.NONE
        self.ask_ns = NEVER_NS  # when to report INCOMPLETE

    def prepare(self, command: Prepare, running: Configured) -> bool:
        """Take a PREPARE of the active manager; `running` is the configuration that runs."""
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
        """Stage the contingency that a PREPARE names, or refuse it with NOT_ON_BOARD."""
        collection, found = self._collection, self.reader.on_board(command.contingency, command.digest)
        assert collection is not None
        if found is None:
            return self.refuse(Reason.NOT_ON_BOARD)
        body, digest = found
        collection.head = SliceHead(0, command.epoch & 0xFF, len(body), digest)
        read = self.reader.read(body, digest)
        return self._stage(read) if isinstance(read, Slice) else self.refuse(read)

    def head(self, command: SliceHead, running: Configured, now_ns: int) -> bool:
        """Take the head of this PE's slice, from the active manager."""
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
        """Take five bytes of this PE's slice, from the active manager."""
        collection = self._collection
        if collection is None or not self._is_about(command.epoch_low, collection.prepare.epoch):
            return False
        if collection.bodies is None:
            collection.bodies = {}
        collection.bodies[command.index] = command.body
        return collection.head is not None and self._check(now_ns)

    def tick(self, now_ns: int) -> bool:
        """Report INCOMPLETE if the frames of a body have stopped coming."""
        if now_ns < self.ask_ns:
            return False
        self.ask_ns = NEVER_NS
        return self.refuse(Reason.INCOMPLETE)

    def refuse(self, reason: Reason) -> bool:
        """Record why a command was refused, for page 1, which is due now."""
        self.reason = reason
        return True

    @property
    def told(self) -> tuple[int, int]:
        """Epoch and digest for page 1: those of the staged epoch, or the epoch being collected with digest 0."""
        if self._collection is not None:
            return self._collection.prepare.epoch, 0
        return self.staged.epoch, self.staged.digest

    def collecting(self) -> bool:
        """Tell whether a slice is being collected."""
        return self._collection is not None

    def _is_about(self, epoch_low: int, epoch: int) -> bool:
        return epoch != NO_EPOCH and epoch_low == epoch & 0xFF

    def _newest(self) -> Prepare | Configured | None:
        """The last PREPARE that was not refused as stale, or the configuration staged from it."""
        if self._collection is not None:
            return self._collection.prepare
        return self.staged if self.staged.epoch != NO_EPOCH else None

    def _is_superseded(self, command: Prepare) -> bool:
        """Tell whether a later PREPARE of the same term was already accepted, so that this one must be refused."""
        newest = self._newest()
        return newest is not None and command.term == self._term and not is_newer(command.epoch, newest.epoch)

    def _check(self, now_ns: int) -> bool:
        """Stage the slice if it is complete and legal; otherwise wait, or refuse it."""
        collection = self._collection
        assert collection is not None
        assert collection.head is not None
        if collection.missing():
            self.ask_ns = now_ns + self._quiet_ns
            return False
        read = self.reader.read(collection.body(), collection.head.digest)
        if isinstance(read, Slice):
            return self._stage(read)
        collection.bodies, self.ask_ns = None, NEVER_NS
        return self.refuse(read)

    def _stage(self, wanted: Slice) -> bool:
        collection = self._collection
        assert collection is not None
        assert collection.head is not None
        prepare, head = collection.prepare, collection.head
        self.staged = Configured(prepare.epoch, prepare.digest, wanted, head.digest, head.length)
        self._drop()
        self.reason = Reason.NONE
        return True

    def _drop(self) -> None:
        self._collection, self.ask_ns = None, NEVER_NS
