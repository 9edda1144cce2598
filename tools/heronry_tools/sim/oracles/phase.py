"""The mission phase that the manager sends is the one that was requested last; verified from orders and frames.

*Requests.* A phase counts as requested in two cases:

- The operator has ordered the phase, and the manager has accepted the order.
- A PE has requested the phase (EMCY, PHASE_REQUEST), and the active manager has acknowledged the request or sends the
  phase.

A PE numbers its requests; a PE that restarts begins with the first number again. A request counts once, even if it is
acknowledged twice. A request does not count if a later request of the same PE was acknowledged before.

A *forward only* request (bit 15 of its detail is set) has effect in two cases only:

- The requested phase has a rule, and the rule names the present phase among the phases from which it may be entered.
- The requested phase has no rule, and comes later in the spec than the present phase.

*Frames on their way.* The manager sends its phase in HOLDS. For a moment after a change, HOLDS may still name the
former phase. If a PE requests the former phase in this moment, such a HOLDS is no answer. The request then counts only
if the manager acknowledges it.

An acknowledgement that the manager sent before it accepted an operator's order may come on the bus after the order.
Then the phase of this acknowledged request counts, until HOLDS names the ordered phase.

*New mastership.* The manager knows a phase from its journal, or from what it heard as a standby manager. It may also
have heard a request that the previous manager did not acknowledge before its failure. The first phase that the manager
sends counts from then on. It must be one of these:

- the phase that counted until then
- a phase that is still requested
- only with two managers or a damaged journal: a phase that counted at an earlier time. Then a request that was
  acknowledged in an earlier term may count again, if the manager sends the requested phase

*Two active managers.* Two managers that do not hear each other may be active under two terms. Neither manager has to
know the phase of the other. Only the phase that the manager of the higher term sends counts: the PEs that know the
higher term accept no command of the lower term, and so no acknowledgement.
"""

from collections.abc import Callable

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import (
    FORWARD_ONLY,
    REQUEST_NUMBERS,
    Control,
    ElementKind,
    Emergency,
    ManagementMessage,
    Operation,
)


class PhaseCheck(Oracle):
    """Determines which phase was requested last, and verifies that the manager sends it."""

    def __init__(self, spec: Spec, entered: Callable[[int, str | None], None]) -> None:
        """Begin with the first phase; `entered` is called with the time (ns) and the phase when a phase begins."""
        super().__init__()
        self.current = spec.initial_phase()
        self.named: str | None = None  # the phase that the active manager sent last
        self._names, self._entered, self._bus = list(spec.phases), entered, spec.manager.bus
        self._from = [
            set(self._names[:index]) if phase.when is None else set(phase.when.origins)
            for index, phase in enumerate(spec.phases.values())
        ]
        self._on_its_way_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._left: dict[str | None, int] = {}  # former phases, and when each ended
        self._ordered: tuple[str | None, int] = (None, 0)  # the last order, and when it was accepted
        self._overtaken: str | None = None  # the ordered phase, if a phase entered since may be older than the order
        self._requested: dict[tuple[int, int], int] = {}  # phase by node and number of the request
        self._acknowledged: dict[int, int] = {}  # by node: number of its last acknowledged request
        self._known_term: dict[int, int] = {}  # by node: the term of that acknowledgement
        self._incarnations: dict[int, int] = {}
        self._heard_term = self._told_term = 0
        self._entered_term = 0  # the highest term whose manager had the current phase
        self._may_forget = self._is_apart = False
        self._stories: set[str] = set()

    def take_over(self, before: "PhaseCheck") -> None:
        """Take over the phase that the oracle of another spec knows, if there is a phase of this name."""
        if before.current in self._names:
            self.current = before.current
        self._may_forget, self._is_apart = before._may_forget, before._is_apart
        self._heard_term, self._told_term = before._heard_term, before._told_term
        self._entered_term, self._incarnations = before._entered_term, before._incarnations

    def may_forget_phase(self) -> None:
        """Allow a manager, from now on, to begin its mastership with a phase that has already ended."""
        self._may_forget = True

    def bus_split(self, _t_ns: int, bus: str, _is_split: bool) -> None:
        """Take into account, from now on, that two active managers may not hear each other.

        No effect if `bus` is not the managers' bus.
        """
        if bus == self._bus:
            self._may_forget = self._is_apart = True

    def manager_copied(self, _station: str, _twin: str) -> None:
        """Allow from now on that two active managers do not hear each other.

        Also allow a manager to begin its mastership with a phase that has already ended.
        """
        self._may_forget = self._is_apart = True

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """Record that an order of the operator has changed the phase.

        For a moment the manager may still send the former phase.
        """
        self._told_term = max(term, self._told_term)
        self._enter(t_ns, phase, term)
        self._ordered = phase, t_ns

    def requested(self, node: int, message: Emergency) -> None:
        """Record an EMCY on the managers' bus in which a PE requests a phase."""
        self._requested[node, message.detail] = message.index

    def told(self, state: StateSaid) -> None:
        """Forget what was acknowledged to a PE if its state shows a new incarnation.

        A PE that has restarted numbers its requests from the beginning, so an old number may come again.
        """
        node, incarnation = state.node, state.page.incarnation
        if self._incarnations.get(node) != incarnation:
            self._incarnations[node] = incarnation
            self._acknowledged.pop(node, None)

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Verify the phase that a HOLDS names, and note which requests for phases a manager acknowledges."""
        if not isinstance(message, Control):
            return
        self._heard_term = max(self._heard_term, message.term)
        if message.a != ElementKind.PHASE:
            return
        if message.operation is Operation.ACKNOWLEDGE:
            self._acknowledge(t_ns, message.term, message.node, message.b)
        elif message.operation is Operation.HOLDS:
            self._tell(t_ns, message.term, self._names[message.b])

    def _acknowledge(self, t_ns: int, term: int, node: int, number: int) -> None:
        index = self._requested.pop((node, number), None)
        if index is None:
            return
        is_new, may_count = not self._is_known(node, number), self._may_count(node, number)
        self._known_term[node] = self._heard_term
        if is_new:
            self._acknowledged[node] = number & ~FORWARD_ONLY
        is_accepted = is_new or (may_count and self.named == self._names[index])
        if is_accepted and not self._leads_back(index, number):
            self._enter(t_ns, self._names[index], term)

    def _is_known(self, node: int, number: int) -> bool:
        """Tell whether this request of a PE, or a later one, was acknowledged before."""
        last = self._acknowledged.get(node)
        behind = 0 if last is None else (last - (number & ~FORWARD_ONLY)) % REQUEST_NUMBERS
        return last is not None and behind < REQUEST_NUMBERS // 2

    def _leads_back(self, index: int, number: int) -> bool:
        """Tell whether a request (index of its phase, number with the mark) is forward only, and leads elsewhere."""
        is_free = self.current is None or self.current == self._names[index] or self.current in self._from[index]
        return bool(number & FORWARD_ONLY) and not is_free

    def _is_wanted(self, phase: str) -> bool:
        """Tell whether some PE has an unanswered request for this phase that a manager may execute."""
        index = self._names.index(phase)
        requests = (key for key, wanted in self._requested.items() if wanted == index)
        return any(self._may_count(*key) and not self._leads_back(index, key[1]) for key in requests)

    def _may_count(self, node: int, number: int) -> bool:
        """Tell whether the active manager may take a request of a node for a new one."""
        # a manager of a newer term may have forgotten that the request was acknowledged
        return not self._is_known(node, number) or (self._may_forget and self._heard_term > self._known_term[node])

    def _tell(self, t_ns: int, term: int, phase: str) -> None:
        if term < self._entered_term:
            return
        is_new, self._told_term, self.named = term > self._told_term, max(term, self._told_term), phase
        if phase == self.current:
            self._entered_term = max(term, self._entered_term)
            if t_ns - self._ordered[1] > self._on_its_way_ns:
                self._overtaken = None
            return
        if phase == self._overtaken:
            self._enter(t_ns, phase, term)
            return
        left_ns = self._left.get(phase)
        is_on_its_way = not is_new and left_ns is not None and t_ns - left_ns <= self._on_its_way_ns
        if (self._is_wanted(phase) and not is_on_its_way) or (not is_new and term > self._entered_term):
            self._enter(t_ns, phase, term)
            return
        if not is_new and not self._is_apart:
            if not is_on_its_way:
                self._complain(t_ns, f"the manager of term {term} sends {phase}, but {self.current} was requested last")
            return
        if not (self._names.index(phase) in self._requested.values() or (self._may_forget and phase in self._left)):
            self._complain(t_ns, f"the manager of term {term} begins with {phase}, but the phase was {self.current}")
        self._enter(t_ns, phase, term)

    def _enter(self, t_ns: int, phase: str, term: int) -> None:
        self._entered_term = term
        if phase != self.current:
            ordered, ordered_ns = self._ordered
            is_young = ordered == self.current and t_ns - ordered_ns <= self._on_its_way_ns
            self._overtaken = ordered if is_young else None
            self._left[self.current], self.current = t_ns, phase
            self._entered(t_ns, phase)

    def _complain(self, t_ns: int, story: str) -> None:
        if story not in self._stories:  # the manager may repeat the wrong phase for a long time
            self._stories.add(story)
            self.violations.append(Violation(t_ns, "phase", story))
