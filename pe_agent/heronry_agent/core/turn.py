"""The present call of the core: its time, and the actions and state pages requested so far.

All parts of the agent share the turn, so that no time and no list has to be passed through every call. A part requests
a page when it has changed something that the state frames report; the core sends each page once, when the call ends.
Only the time and the counts are kept from one call to the next.
"""

from collections import Counter

from heronry_agent.core.vocabulary import Action, Note
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS
from heronry_wire.sansio import Withdraw
from heronry_wire.standstill import Standstills


class Turn:
    """The present call of the core."""

    __slots__ = (
        *("arrived_ns", "counts", "held_until_ns", "now_ns", "out", "rewired", "standstills"),
        *("wants_page_0", "wants_page_1"),
    )

    def __init__(self, now_ns: int, period_ns: int = USUAL_HEARTBEAT_NS) -> None:
        """period_ns: heartbeat period of the uplink."""
        self.now_ns = now_ns
        self.arrived_ns = now_ns  # arrival of the present frame: before now_ns if the process was paused
        self.held_until_ns = now_ns - 1  # end of the last pause: a frame from before it may be outdated by a later one
        self.counts: Counter[tuple[str, int]] = Counter()  # malformed or refused, by cause and identifier; never reset
        self.standstills = Standstills(period_ns)
        self.out: list[Action] = []
        self.wants_page_0 = self.wants_page_1 = self.rewired = False

    def begin(self, now_ns: int) -> list[Action]:
        """Begin the next call; raises ValueError when time goes back."""
        if now_ns < self.now_ns:
            raise ValueError(f"time went back from {self.now_ns} to {now_ns}: give the agent a monotonic clock")
        self.now_ns = self.arrived_ns = now_ns
        self.out = []
        self.wants_page_0 = self.wants_page_1 = self.rewired = False
        return self.out

    def arrived(self, age_ns: int, late_ns: int) -> None:
        """Note the age of the present frame; an age above `late_ns` shows that this process was paused."""
        self.arrived_ns = self.now_ns - age_ns
        if age_ns > late_ns:
            self.held_until_ns = self.now_ns

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Have the driver withdraw the frames that wait under these identifiers; no effect without identifiers."""
        if identifiers:
            self.out.append(Withdraw(identifiers))

    def note(self, kind: str, text: str) -> None:
        """Add a line for the log; `kind` is a word to filter by."""
        self.out.append(Note(kind, text))

    def count(self, what: str, identifier: int) -> None:
        """Count a malformed or refused frame or answer, by cause and identifier (or module)."""
        self.counts[what, identifier] += 1
