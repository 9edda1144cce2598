"""The mission phase, judged from orders and frames: it is what was asked for last, and nothing else is told.

Asked for is what the operator has ordered and the manager obeyed, and what a PE has requested (EMCY, PHASE_REQUEST)
once the manager that reigns has acknowledged it. A request carries a number: acknowledged twice it counts once, until
its PE is lost or starts anew, or another term begins. One that only leads on never leads back. Told is what HOLDS
names.

A new reign knows what it remembers, or has heard while it stood by, and may have heard a request that its predecessor
did not live to acknowledge. What it tells first is true from then on: where one manager flies with a sound journal, the
phase as it was, or one that is still requested; else also one that was left before.
"""

from collections.abc import Callable

from heronry_dg.model import Spec
from heronry_tools.simulator.violation import Violation
from heronry_wire.management import FORWARD_ONLY, LEASE_PERIODS, Control, ElementKind, Emergency, Operation


class PhaseCheck:
    """Follows who wants which phase, and which is told."""

    def __init__(self, spec: Spec, entered: Callable[[int, str | None], None]) -> None:
        """`entered` is told when a phase begins."""
        self.violations: list[Violation] = []
        self.current = spec.initial_phase()
        self.told: str | None = None
        self._names, self._entered = list(spec.phases), entered
        self._on_its_way_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._left: dict[str | None, int] = {}  # phases that were, and when they ended
        self._requested: dict[tuple[int, int], int] = {}  # phase by node and number of the request
        self._acknowledged: dict[int, int] = {}  # number of the last request by node
        self._incarnations: dict[int, int] = {}
        self._heard_term = self._told_term = 0
        self._may_forget = self._is_apart = False
        self._stories: set[str] = set()

    def may_forget(self) -> None:
        """From now on a manager may begin its reign with less than was known."""
        self._may_forget = True

    def apart(self) -> None:
        """From now on two managers may reign that do not hear each other."""
        self._may_forget = self._is_apart = True

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """The operator's order was obeyed in a term: what that one began with is over, though it may still be told."""
        self._told_term = max(term, self._told_term)
        self._enter(t_ns, phase)

    def requested(self, node: int, request: Emergency) -> None:
        """A PE asks for a phase, on the managers' bus."""
        self._requested[node, request.detail] = request.index

    def started(self, node: int, incarnation: int) -> None:
        """A PE has told its incarnation: a new one counts its requests anew."""
        if self._incarnations.get(node) != incarnation:
            self._incarnations[node] = incarnation
            self.lost(node)

    def lost(self, node: int) -> None:
        """A PE is not counted on."""
        self._acknowledged.pop(node, None)

    def commanded(self, t_ns: int, message: Control) -> None:
        """The manager that reigns acknowledges a request, or tells the phase."""
        if message.term > self._heard_term:
            self._heard_term = message.term
            self._acknowledged.clear()
        if message.a != ElementKind.PHASE:
            return
        if message.operation is Operation.ACKNOWLEDGE:
            self._acknowledge(t_ns, message.node, message.b)
        elif message.operation is Operation.HOLDS:
            self._tell(t_ns, message.term, self._names[message.b])

    def _acknowledge(self, t_ns: int, node: int, number: int) -> None:
        index = self._requested.pop((node, number), None)
        if index is None or self._acknowledged.get(node) == number:
            return
        self._acknowledged[node] = number
        if number & FORWARD_ONLY and self.current is not None and index < self._names.index(self.current):
            return
        self._enter(t_ns, self._names[index])

    def _tell(self, t_ns: int, term: int, phase: str) -> None:
        is_new, self._told_term, self.told = term > self._told_term, max(term, self._told_term), phase
        if phase == self.current:
            return
        if not is_new and not self._is_apart:
            left_ns = self._left.get(phase)
            if left_ns is None or t_ns - left_ns > self._on_its_way_ns:
                self._complain(t_ns, f"{phase} is told in term {term}, and asked for was {self.current}")
            return
        if not (self._names.index(phase) in self._requested.values() or (self._may_forget and phase in self._left)):
            self._complain(t_ns, f"term {term} begins in {phase}, and the phase was {self.current}")
        self._enter(t_ns, phase)

    def _enter(self, t_ns: int, phase: str) -> None:
        if phase != self.current:
            self._left[self.current], self.current = t_ns, phase
            self._entered(t_ns, phase)

    def _complain(self, t_ns: int, story: str) -> None:
        if story not in self._stories:  # it may be told for long
            self._stories.add(story)
            self.violations.append(Violation(t_ns, "phase", story))
