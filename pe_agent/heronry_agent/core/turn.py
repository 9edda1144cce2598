"""One call of the core: what time it is, and what has been asked for so far.

The parts that act share the turn instead of handing a time and a list through every call. A part that has changed what
the state frames tell asks for a page; the core sends each page once, when the call ends. Nothing is held from one call
to the next but the time.
"""

from collections import Counter

from heronry_agent.core.vocabulary import Action, Note
from heronry_wire.sansio import Withdraw


class Turn:
    """The call being served."""

    __slots__ = ("arrived_ns", "counts", "held_until_ns", "now_ns", "out", "rewired", "wants_page_0", "wants_page_1")

    def __init__(self, now_ns: int) -> None:
        self.now_ns = now_ns
        self.arrived_ns = now_ns  # when the frame being taken came: earlier than now after a pause of the process
        self.held_until_ns = now_ns - 1  # until when the process was: what came before that may have news behind it
        self.counts: Counter[tuple[str, int]] = Counter()  # what was not understood or obeyed, by identifier; for ever
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
        """A frame is being taken that came so long ago; one that is later than `late_ns` shows that nobody ran."""
        self.arrived_ns = self.now_ns - age_ns
        if age_ns > late_ns:
            self.held_until_ns = self.now_ns

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Take back what waits under these identifiers, if there are any."""
        if identifiers:
            self.out.append(Withdraw(identifiers))

    def note(self, kind: str, text: str) -> None:
        """Ask for a line in the log."""
        self.out.append(Note(kind, text))

    def count(self, what: str, identifier: int) -> None:
        """Count what is not worth more."""
        self.counts[what, identifier] += 1
