"""The state of the protocol, derived from the manager's events; faults can wait for such a state.

    planning    a plan has been requested and has not come
    preparing   the slices of an epoch have been sent, and some PE has not staged its slice
    activating  the first ACTIVATE has been sent, but not yet the last step (GO_ALL)
    going       the last step has been sent, and some PE is not ACTIVE
    suspect     none of the above, and a PE has missed a heartbeat
    rejoining   none of the above, and a PE that was down was heard again in the last 2 s, and is in its
                hold-down
    orphaned    no active manager can be heard; this takes precedence over all others
    idle        none of the above

A fault that waits for a state is injected shortly after the protocol has entered this state. If the protocol is
in the state already, the fault is injected shortly after the time of the fault (`injection.schedule`).
"""

from collections import Counter
from collections.abc import Callable, Mapping

from heronry_manager import events
from heronry_tools.sim.world.clock import Clock

ORPHANED = "orphaned"
STATES = ("idle", "suspect", "planning", "preparing", "activating", "going", "rejoining", ORPHANED)

_FOLLOWS: Mapping[type[events.Event], str] = {
    events.ManagerStarted: "idle",
    events.TakenOver: "idle",
    events.PlanRequested: "planning",
    events.PlanUnchanged: "idle",
    events.PlanKept: "idle",
    events.PlanFailed: "idle",
    events.EpochPrepared: "preparing",
    events.EpochAbandoned: "planning",
    events.Reconfigured: "idle",
}
# For this time after a PE was heard again it counts as rejoining; it may fall silent during its hold-down.
_FORGOTTEN_AFTER_NS = 2_000_000_000


class ProtocolState:
    """Derives the state of the protocol from the events of one flight's managers."""

    def __init__(self, clock: Clock) -> None:
        self.entered: Counter[str] = Counter()  # how often each state has begun
        self._clock = clock
        self._before = "idle"
        self._reconfiguring = "idle"
        self._suspects: set[str] = set()
        self._returning: dict[str, int] = {}
        self._is_orphaned = False
        self._waiting: list[tuple[str, int, Callable[[], None]]] = []  # state, earliest time, what to call

    @property
    def now(self) -> str:
        """Return the present state, one of STATES."""
        if self._is_orphaned:
            return ORPHANED
        if self._reconfiguring != "idle":
            return self._reconfiguring
        if self._suspects:
            return "suspect"
        since_ns = self._clock.now_ns - _FORGOTTEN_AFTER_NS
        return "rejoining" if any(at_ns > since_ns for at_ns in self._returning.values()) else "idle"

    def take(self, event: events.Event) -> None:
        """Update the state by an event of a manager."""
        self._reconfiguring = _FOLLOWS.get(type(event), self._reconfiguring)
        match event:
            case events.EpochStep(step=step):
                self._reconfiguring = "going" if step == "GO_ALL" else "activating"
            case events.PeSuspected(pe=pe):
                self._suspects.add(pe)
            case events.PeAnswered(pe=pe):
                self._suspects.discard(pe)
            case events.PeLost(pe=pe):
                self._suspects.discard(pe)
                self._returning.pop(pe, None)
            case events.PeHeardAgain(pe=pe):
                self._returning[pe] = self._clock.now_ns
            case events.PeJoined(pe=pe):
                self._returning.pop(pe, None)
            case events.ManagerStarted() | events.TakenOver():
                self._suspects.clear()
                self._returning.clear()
            case _:
                pass
        self._moved()

    def set_active_manager(self, *, is_heard: bool) -> None:
        """Set whether an active manager can be heard now."""
        if self._is_orphaned is is_heard:
            self._is_orphaned = not is_heard
            self._moved()

    def _moved(self) -> None:
        """Call the callbacks that are due; before that, if the state has changed, count the entry into it.

        A callback is due if it waits for the present state, and its earliest time has come.
        """
        if self.now != self._before:
            self._before = self.now
            self.entered[self._before] += 1
        self._call_waiting()

    def when(self, state: str, not_before_ns: int, what: Callable[[], None]) -> None:
        """Call `what` once, when the protocol is in `state`, but not before `not_before_ns`.

        If the protocol is in the state at that time, the call comes then; if not, when the state next begins.
        """
        self._waiting.append((state, not_before_ns, what))
        self._clock.at(not_before_ns, self._call_waiting)

    def _call_waiting(self) -> None:
        if not self._waiting:
            return
        state, now_ns = self.now, self._clock.now_ns
        called = [one for one in self._waiting if one[0] == state and one[1] <= now_ns]
        if called:
            self._waiting = [one for one in self._waiting if one not in called]
            for _, _, what in called:
                what()
