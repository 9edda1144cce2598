"""The operator of a simulated aircraft: gives orders to the manager that commands, and hears at once whether it obeys.

What was obeyed is the truth: an element that was failed is as good as down until it is cleared. An order for which
there is nobody is not given; that something is well again is said as soon as somebody can hear it.

Where there are two managers, a term can end before the other one has heard what was said in it, and nobody promises
that it comes to know. An operator who looks at the status sees that, and says it again to the next one (`insist`). To
a manager that has only its journal, nothing is said twice.
"""

from heronry_dg.losses import lost_elements
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.core.vocabulary import AskStatus, ClearElement, EnterPhase, FailElement, Reply
from heronry_tools.sim.flight.managers import Managers
from heronry_tools.sim.flight.truth import Truth
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock

Order = EnterPhase | FailElement | ClearElement

_AGAIN_NS = 100_000_000
_AWAY = ("down", "returning")


class Operator:
    """Gives orders, and remembers them."""

    def __init__(self, spec: Spec, clock: Clock, managers: Managers, checks: Checks, truth: Truth) -> None:
        self._spec, self._clock = spec, clock
        self._managers, self._checks, self._truth = managers, checks, truth
        self._well: dict[str, int | None] = {}  # elements that were cleared, and whom it was told; None: nobody yet
        self._insists = False

    @property
    def failed(self) -> frozenset[str]:
        """Elements that count as failed, whatever is heard of them."""
        return frozenset(self._truth.declared)

    def say(self, order: Order) -> Reply | None:
        """Give an order to whoever commands; gives the answer, None where nobody does."""
        manager = self._managers.commanding
        reply = None if manager is None else manager.say(order)
        if manager is None or reply is None or not reply.done:
            return reply
        term = manager.core.term
        if isinstance(order, FailElement):
            self._well.pop(order.element, None)
            self._truth.declared[order.element] = term
            self._checks.declared(self._clock.now_ns, order.element)
            self._excuse_idle(order.element)
        elif isinstance(order, ClearElement):
            self._is_well(order.element, term)
        elif isinstance(order, EnterPhase):
            self._checks.ordered(self._clock.now_ns, order.phase, term)
        return reply

    def clear(self, element: str) -> None:
        """Say that an element is well again, as soon as somebody commands."""
        self._well[element] = None
        self._look()

    def latched(self) -> list[str]:
        """What counts as failed, or is kept away for long, and not because it was declared failed here."""
        manager = self._managers.commanding
        status = None if manager is None else manager.say(AskStatus()).status
        if status is None:
            return []
        held = {one["element"] for one in status["latched"]}
        held |= {f"pe:{name}" for name, pe in status["pes"].items() if pe["losses"] > 1 and pe["state"] in _AWAY}
        return sorted(held - self._truth.declared.keys())

    def insist(self) -> None:
        """Say again, from now on, what a manager may not know that has taken the place of another."""
        self._insists = self._managers.are_two and bool(self._truth.declared or self._well)
        self._look()

    def _look(self) -> None:
        """See who commands, and say what there is to be said; look again as long as there may be more."""
        manager = self._managers.commanding
        if manager is not None:
            term = manager.core.term
            for element, failed_in in list(self._truth.declared.items()):
                if self._insists and failed_in != term and element not in self._well:
                    self.say(FailElement(element))
            for element, cleared_in in list(self._well.items()):
                if cleared_in == term or not (cleared_in is None or self._insists):
                    continue
                manager.say(ClearElement(element))  # who refuses holds nothing against it
                self._is_well(element, term)
        if self._insists or None in self._well.values():
            self._clock.at(self._clock.now_ns + _AGAIN_NS, self._look)

    def _is_well(self, element: str, term: int) -> None:
        """An element has been taken for well; a module begins anew, and may fail again."""
        everywhere = not self._managers.are_two
        self._checks.cleared(self._clock.now_ns, element, self._truth.situation, everywhere=everywhere)
        if element.startswith("module:"):
            self._truth.is_back(element)
        self._truth.declared.pop(element, None)
        self._well[element] = term

    def _excuse_idle(self, element: str) -> None:
        """Whatever is not driven because of an order may look stuck."""
        lost = lost_elements(self._spec, Situation(frozenset({element})))
        for module in self._spec.modules.values():
            if f"module:{module.name}" in lost or f"device:{module.device}" in lost:
                self._truth.excuse(module.name)
