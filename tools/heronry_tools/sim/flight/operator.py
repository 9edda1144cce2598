"""The operator of a simulated aircraft: gives orders to the manager that reigns, and hears at once whether it obeys.

What was obeyed is the truth: an element that was failed is as good as down until it is cleared. An order for which
there is nobody is not given; that something is well again is said as soon as somebody can hear it.

Where there are two managers, a reign can end before the other one has heard what was said to it, and nobody promises
that it comes to know. An operator who looks at the status sees that, and says it again to the new reign (`insist`). To
a manager that has only its journal, nothing is said twice.
"""

from typing import TYPE_CHECKING

from heronry_dg.losses import lost_elements
from heronry_dg.situation import Situation
from heronry_manager.core.vocabulary import AskStatus, ClearElement, EnterPhase, FailElement, Reply

if TYPE_CHECKING:
    from heronry_tools.sim.flight.simulation import Simulation
    from heronry_tools.sim.world.simulated_manager import SimulatedManager

Order = EnterPhase | FailElement | ClearElement

_AGAIN_NS = 100_000_000
_AWAY = ("down", "returning")


class Operator:
    """Gives orders, and remembers them."""

    def __init__(self, simulation: "Simulation") -> None:
        self._simulation = simulation
        self._failed: dict[str, int] = {}  # elements that count as failed, and the term that was told last
        self._well: dict[str, int | None] = {}  # elements that do not any more; None: nobody has been told
        self._insists = False

    @property
    def failed(self) -> frozenset[str]:
        """Elements that count as failed, whatever is heard of them."""
        return frozenset(self._failed)

    def say(self, order: Order) -> Reply | None:
        """Give an order to whoever reigns; gives the answer, None where nobody does."""
        manager = self._who_reigns()
        reply = None if manager is None else manager.say(order)
        if manager is None or reply is None or not reply.done:
            return reply
        term = manager.core.term
        if isinstance(order, FailElement):
            self._well.pop(order.element, None)
            self._failed[order.element] = term
            self._simulation.checks.declared(self._simulation.now_ns, order.element)
            self._excuse_idle(order.element)
        elif isinstance(order, ClearElement):
            self._is_well(order.element, term)
        elif isinstance(order, EnterPhase):
            self._simulation.checks.phases.ordered(self._simulation.now_ns, order.phase, term)
        return reply

    def clear(self, element: str) -> None:
        """Say that an element is well again, as soon as somebody reigns."""
        self._well[element] = None
        self._look()

    def latched(self) -> list[str]:
        """What counts as failed, or is kept away for long, and not because it was declared failed here."""
        manager = self._who_reigns()
        status = None if manager is None else manager.say(AskStatus()).status
        if status is None:
            return []
        held = {one["element"] for one in status["latched"]}
        held |= {f"pe:{name}" for name, pe in status["pes"].items() if pe["losses"] > 1 and pe["state"] in _AWAY}
        return sorted(held - self._failed.keys())

    def insist(self) -> None:
        """Say again, from now on, what a reign may not know that has taken the place of another."""
        self._insists = self._simulation.has_standby and bool(self._failed or self._well)
        self._look()

    def _look(self) -> None:
        """See who reigns, and say what there is to be said; look again as long as there may be more."""
        manager = self._who_reigns()
        if manager is not None:
            term = manager.core.term
            for element, failed_in in list(self._failed.items()):
                if self._insists and failed_in != term and element not in self._well:
                    self.say(FailElement(element))
            for element, cleared_in in list(self._well.items()):
                if cleared_in == term or not (cleared_in is None or self._insists):
                    continue
                manager.say(ClearElement(element))  # who refuses holds nothing against it
                self._is_well(element, term)
        if self._insists or None in self._well.values():
            self._simulation.at(self._simulation.now_ns + _AGAIN_NS, self._look)

    def _is_well(self, element: str, term: int) -> None:
        self._simulation.cleared(element)
        self._failed.pop(element, None)
        self._well[element] = term

    def _excuse_idle(self, element: str) -> None:
        """Whatever is not driven because of an order may look stuck."""
        spec = self._simulation.spec
        lost = lost_elements(spec, Situation(frozenset({element})))
        for module in spec.modules.values():
            if f"module:{module.name}" in lost or f"device:{module.device}" in lost:
                self._simulation.excuse(module.name)

    def _who_reigns(self) -> "SimulatedManager | None":
        manager = self._simulation.manager
        return manager if manager is not None and manager.is_awake and manager.core.reigns else None
