"""The configuration that each PE runs, by the PE's own reports. `epoch` keeps what was commanded.

If a state is lost, the next one replaces it. A state that comes twice, or late from a gateway, has no effect. After a
pause of the manager, states are taken in the order in which they came, and the last one counts. A lost PE may still run
the epoch that it reported last, so that epoch is kept (`newest_epoch`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_wire.management import NO_EPOCH, newest_epoch
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

_MOST_LATE = 8  # a page 0 that is more numbers behind the last one is not late, but a new one after a silence


@dataclass(slots=True)
class Observed:
    """What one PE runs, as the PE has reported it."""

    epoch: int = 0
    digest: int = 0
    state: PeState = PeState.UNCONFIGURED
    configured: bool = False  # has been seen to run an epoch of this manager in this incarnation
    hears: bool = False  # has reported since this term began that it hears a LEASE
    said: tuple[int, int] | None = None  # incarnation and sequence of its last page 0

    def is_late(self, page: StatePage0) -> bool:
        """Tell whether a page 0 is older than the last one that was noted: a gateway may have forwarded it late."""
        if self.said is None or self.said[0] != page.incarnation:
            return False
        return 1 <= (self.said[1] - page.sequence) % 256 <= _MOST_LATE


class Observations:
    """Keeps what each PE last reported about its epoch, whether the PE is available or not."""

    def __init__(self, pes: Iterable[str]) -> None:
        self.of = {pe: Observed() for pe in pes}
        self._newest_lost = NO_EPOCH  # newest epoch that some PE ran when it was lost

    def begin_term(self) -> None:
        """Note that a term begins: no PE has reported yet that it hears a LEASE of this term."""
        for seen in self.of.values():
            seen.hears = False

    def take(self, pe: str, page: StatePage0) -> Observed | None:
        """Note page 0 of a PE, and return what is now known of the PE.

        Returns None, and notes nothing, if the page is late: a newer page of this PE was noted before.
        """
        seen = self.of[pe]
        if seen.is_late(page):
            return None
        seen.said = page.incarnation, page.sequence
        seen.epoch, seen.digest, seen.state = page.epoch, page.digest, page.state
        seen.hears = seen.hears or PeFlags.HEARS_LEASE in page.flags
        return seen

    def joined(self, pe: str) -> None:
        """Note that a PE is available again, and must be configured anew by this manager."""
        self.of[pe].configured = False

    def lost(self, pe: str) -> None:
        """Forget what a PE that is no longer available has reported; only its epoch is kept for `newest_epoch`."""
        self._newest_lost = newest_epoch((self._newest_lost, self.of[pe].epoch))
        self.of[pe] = Observed()

    def runs_unknown(self, pe: str) -> bool:
        """Tell whether a PE runs what this manager neither knows nor has commanded, as the PE reported last."""
        seen = self.of[pe]
        return seen.state is not PeState.UNCONFIGURED and not seen.configured

    def newest_epoch(self) -> int:
        """Return the newest epoch that any PE, available or not, has reported to run."""
        return newest_epoch((self._newest_lost, *(seen.epoch for seen in self.of.values())))
