"""What each PE says that it runs, and nothing else: observed, never commanded.

A state that is lost is followed by the next one, and one that comes twice tells nothing new; one that comes late, from
a gateway, tells nothing at all. After a pause states are taken in the order in which they came, and the last one
counts. What a PE has said last before it was lost, it may run still: its epoch is kept (`newest_epoch`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_wire.management import NO_EPOCH, newest_epoch
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

_MOST_LATE = 8  # pages 0: one that is further behind is new, after a silence


@dataclass(slots=True)
class Observed:
    """What one PE says that it runs."""

    epoch: int = 0
    digest: int = 0
    state: PeState = PeState.UNCONFIGURED
    configured: bool = False  # has been seen to run something of ours in this incarnation
    hears: bool = False  # has said since this term began that it hears a LEASE
    said: tuple[int, int] | None = None  # incarnation and sequence of its last page 0

    def is_late(self, page: StatePage0) -> bool:
        """Tell whether a page was said before the last one: a gateway may hand it on late."""
        if self.said is None or self.said[0] != page.incarnation:
            return False
        return 1 <= (self.said[1] - page.sequence) % 256 <= _MOST_LATE


class Observations:
    """What all PEs say, whether they are counted on or not."""

    def __init__(self, pes: Iterable[str]) -> None:
        self.of = {pe: Observed() for pe in pes}
        self._newest_lost = NO_EPOCH  # newest epoch that some PE ran when it was lost

    def begin_term(self) -> None:
        """Begin to speak: no PE has heard this term yet."""
        for seen in self.of.values():
            seen.hears = False

    def take(self, pe: str, page: StatePage0) -> Observed | None:
        """Take page 0 of a PE; gives what is known of it now, or None where the page is late."""
        seen = self.of[pe]
        if seen.is_late(page):
            return None
        seen.said = page.incarnation, page.sequence
        seen.epoch, seen.digest, seen.state = page.epoch, page.digest, page.state
        seen.hears = seen.hears or PeFlags.HEARS_LEASE in page.flags
        return seen

    def joined(self, pe: str) -> None:
        """A PE is counted on again: it has been given nothing yet."""
        self.of[pe].configured = False

    def lost(self, pe: str) -> None:
        """A PE is no longer counted on."""
        self._newest_lost = newest_epoch((self._newest_lost, self.of[pe].epoch))
        self.of[pe] = Observed()

    def newest_epoch(self) -> int:
        """Newest epoch that a PE has said it runs, whether it is counted on or not."""
        return newest_epoch((self._newest_lost, *(seen.epoch for seen in self.of.values())))
