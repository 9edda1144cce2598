"""The present call of the core: its time, and the actions and state pages that the parts have requested so far.

All parts of the agent share one `Turn`, so that the time and the list of actions need not be passed through every call.
If a part changes something that the state frames report, the part requests a state page; the core sends each requested
page once, when the call ends. The next call begins without actions and requests, but the counts stay.
"""

from collections import Counter

from heronry_agent.core.vocabulary import Action, Note
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS
from heronry_wire.sansio import Withdraw
from heronry_wire.standstill import Standstills


class Turn:
    """What all parts of the agent share during one call of the core."""

    __slots__ = (
        "actions",
        "arrived_ns",
        "counts",
        "held_until_ns",
        "now_ns",
        "rewired",
        "standstills",
        "wants_page_0",
        "wants_page_1",
    )

    def __init__(self, now_ns: int, period_ns: int = USUAL_HEARTBEAT_NS) -> None:
        """Begin at `now_ns`; `period_ns` is the heartbeat period of the uplink."""
        self.now_ns = now_ns
        self.arrived_ns = now_ns  # arrival of the present frame: before now_ns if the process was paused
        self.held_until_ns = now_ns - 1  # end of the last pause of the process: frames from before may be outdated
        self.counts: Counter[tuple[str, int]] = Counter()  # malformed or refused, by cause and identifier; never reset
        self.standstills = Standstills(period_ns)
        self.actions: list[Action] = []  # that were requested since the last `end`
        self.wants_page_0 = self.wants_page_1 = self.rewired = False

    def begin(self, now_ns: int) -> None:
        """Begin a call of the core, without actions and requests; raises ValueError if time goes back."""
        if now_ns < self.now_ns:
            raise ValueError(f"time went back from {self.now_ns} to {now_ns}: give the agent a monotonic clock")
        self.now_ns = self.arrived_ns = now_ns
        self.wants_page_0 = self.wants_page_1 = self.rewired = False

    def do(self, *actions: Action) -> None:
        """Have the driver do these actions, after those of this call so far."""
        self.actions += actions

    def end(self) -> list[Action]:
        """Return all actions that were requested since the last call of this method, in order, and forget them."""
        actions, self.actions = self.actions, []
        return actions

    def arrived(self, age_ns: int, late_ns: int) -> None:
        """Set the age in ns of the frame that the core handles in its present call.

        If the age exceeds `late_ns`, this process was paused. Then all frames that arrived up to now may be
        outdated, and `held_until_ns` is set to this moment.
        """
        self.arrived_ns = self.now_ns - age_ns
        if age_ns > late_ns:
            self.held_until_ns = self.now_ns

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Have the driver drop unsent frames with these CAN identifiers."""
        if identifiers:
            self.do(Withdraw(identifiers))

    def note(self, kind: str, text: str) -> None:
        """Add a line to the log; `kind` is one word, by which lines can be filtered."""
        self.do(Note(kind, text))

    def count(self, what: str, identifier: int) -> None:
        """Count one more frame or answer that is malformed or refused; `what` is the cause.

        identifier: CAN identifier of the frame, or index of the module that answered.
        """
        self.counts[what, identifier] += 1
