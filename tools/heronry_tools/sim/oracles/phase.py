"""The mission phase, verified from orders and frames: it is what was requested last, and no other is sent.

A phase counts as requested when the manager has accepted the operator's order for it, or when a PE has requested it
(EMCY, PHASE_REQUEST) and the active manager has acknowledged the request or sends that phase. A request carries a
number. A request that is acknowledged twice counts once. One that is acknowledged after a later one of the same PE does
not count; a PE that starts anew counts its requests anew. A request that is *forward only* never leads to an earlier
phase.

The phase that is *told* is the one that HOLDS names. For a moment that may be the phase that was just left. If a PE
requests that phase, HOLDS alone does not make the request count then: the manager must acknowledge it too. Such an
acknowledgement may have been sent before an operator's order and be heard after it: then the ordered phase counts again
as soon as it is told.

A new mastership knows what its manager remembers or has heard as a standby manager, and may have heard a request that
the previous manager did not acknowledge before it failed. The phase that it tells first is the true one from then on.
Where one manager flies and its journal is intact, that must be the phase as it was, or one that is still requested.
Otherwise it may also be a phase that was left before, and a request that was acknowledged in an earlier term may count
again, if that mastership tells its phase.

A manager that has begun a higher term, and was not heard for a while, need not know what a deposed manager has
acknowledged meanwhile: no PE has accepted that. A manager that goes on in a lower term, because it hears no node, need
not know the phase of a higher term whose manager has fallen silent; what it tells has no effect.
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
    """Follows which phases are requested, and which one is told."""

    def __init__(self, spec: Spec, entered: Callable[[int, str | None], None]) -> None:
        """`entered` is told when a phase begins."""
        super().__init__()
        self.current = spec.initial_phase()
        self.named: str | None = None  # by the active manager
        self._names, self._entered, self._bus = list(spec.phases), entered, spec.manager.bus
        self._on_its_way_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._left: dict[str | None, int] = {}  # phases that were, and when they ended
        self._ordered: tuple[str | None, int] = (None, 0)  # the last order, and when it was accepted
        self._overtaken: str | None = None  # what was ordered, if what has come since may be older
        self._requested: dict[tuple[int, int], int] = {}  # phase by node and number of the request
        self._acknowledged: dict[int, int] = {}  # number of the last request by node
        self._known_term: dict[int, int] = {}  # in which it was acknowledged
        self._incarnations: dict[int, int] = {}
        self._heard_term = self._told_term = 0
        self._entered_term = 0  # the highest that holds the current phase
        self._may_forget = self._is_apart = False
        self._stories: set[str] = set()

    def may_forget_phase(self) -> None:
        """From now on a manager may begin its mastership with less than was known."""
        self._may_forget = True

    def bus_split(self, _t_ns: int, bus: str, _is_split: bool) -> None:
        """From now on two managers may be active that do not hear each other."""
        if bus == self._bus:
            self._may_forget = self._is_apart = True

    def manager_copied(self, _station: str, _twin: str) -> None:
        """From now on two managers may be active that do not hear each other."""
        self._may_forget = self._is_apart = True

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """The operator's order was accepted in a term: the phase it began with is over, though it may still be told."""
        self._told_term = max(term, self._told_term)
        self._enter(t_ns, phase, term)
        self._ordered = phase, t_ns

    def requested(self, node: int, message: Emergency) -> None:
        """A PE requests a phase, on the managers' bus."""
        self._requested[node, message.detail] = message.index

    def told(self, state: StateSaid) -> None:
        """A PE has reported its incarnation: a new one counts its requests anew."""
        node, incarnation = state.node, state.page.incarnation
        if self._incarnations.get(node) != incarnation:
            self._incarnations[node] = incarnation
            self._acknowledged.pop(node, None)

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """The active manager acknowledges a request, or tells the phase."""
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
        """Tell whether a request, or a later one, was acknowledged before."""
        last = self._acknowledged.get(node)
        behind = 0 if last is None else (last - (number & ~FORWARD_ONLY)) % REQUEST_NUMBERS
        return last is not None and behind < REQUEST_NUMBERS // 2

    def _leads_back(self, index: int, number: int) -> bool:
        """Tell whether a request must not be accepted, since it only leads on and this would lead back."""
        return bool(number & FORWARD_ONLY) and self.current is not None and index < self._names.index(self.current)

    def _is_wanted(self, phase: str) -> bool:
        """Tell whether a PE waits for an answer whose request for this phase may be accepted."""
        index = self._names.index(phase)
        requests = (key for key, wanted in self._requested.items() if wanted == index)
        return any(self._may_count(*key) and not self._leads_back(index, key[1]) for key in requests)

    def _may_count(self, node: int, number: int) -> bool:
        """Tell whether a request may be new to the active manager."""
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
                self._complain(t_ns, f"{phase} is told in term {term}, and {self.current} was requested")
            return
        if not (self._names.index(phase) in self._requested.values() or (self._may_forget and phase in self._left)):
            self._complain(t_ns, f"term {term} begins in {phase}, and the phase was {self.current}")
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
        if story not in self._stories:  # it may be told for long
            self._stories.add(story)
            self.violations.append(Violation(t_ns, "phase", story))
