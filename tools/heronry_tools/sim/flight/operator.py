"""The operator of a simulated aircraft, who gives orders to the active manager; the manager accepts or refuses each.

*Truth.* For the oracles, an accepted order is the truth: an element that was declared failed counts as down until it is
cleared. If a module has failed everywhere, it stays down on every PE until the module itself is cleared. An order to
clear one of its places then changes nothing.

*No active manager.* Then no order can be given. There is one exception: the order to clear an element is kept, and
given as soon as a manager is active.

*Two managers.* A term can end before the other manager has heard of an order. The protocol does not promise that the
next manager learns of this order. A real operator sees in the status that the order is missing, and repeats it. So does
this operator after `insist`: in each new term it repeats the orders by which it has declared elements failed or cleared
them.

*One manager.* Nothing is repeated, since a manager that restarts reads the orders in its journal.
"""

from heronry_dg.losses import lost_elements
from heronry_dg.situation import Situation, is_place, module_of
from heronry_manager.core.intake import parts_of
from heronry_manager.core.vocabulary import (
    AskStatus,
    ClearElement,
    EnterPhase,
    FailElement,
    ReleaseTarget,
    Reply,
    RestoreElement,
    RetireElement,
    SetPriority,
)
from heronry_manager.shell.control_protocol import FlyScript
from heronry_manager.shell.script_orders import target_of
from heronry_tools.sim.flight.managers import Managers
from heronry_tools.sim.flight.truth import Truth
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock

OfElement = FailElement | ClearElement | RetireElement | RestoreElement
Order = EnterPhase | SetPriority | OfElement | FlyScript | ReleaseTarget

_AGAIN_NS = 100_000_000
_AWAY = ("down", "returning")


class Operator:
    """Gives orders to the active manager.

    It keeps those orders that declare an element failed or clear an element, and can repeat them to a later
    manager (`insist`).
    """

    def __init__(self, clock: Clock, managers: Managers, checks: Checks, truth: Truth) -> None:
        self._clock = clock
        self._managers, self._checks, self._truth = managers, checks, truth
        self._well: dict[str, int | None] = {}  # cleared elements: the term that got the order; None: not yet given
        self._insists = False

    @property
    def failed(self) -> frozenset[str]:
        """Return the elements that the operator has declared failed and not cleared."""
        return frozenset(self._truth.declared)

    def say(self, order: Order) -> Reply | None:
        """Give an order to the active manager and return its answer; None if no manager is active."""
        manager = self._managers.commanding
        reply = None
        if manager is not None:
            said = target_of(order.text, manager.spec, manager.core) if isinstance(order, FlyScript) else order
            reply = manager.say(said)
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
        elif isinstance(order, RetireElement):
            for part in parts_of(manager.spec, order.element):
                self._well.pop(part, None)
                self._truth.declared[part] = term
                self._checks.declared(self._clock.now_ns, part)
        elif isinstance(order, RestoreElement):
            for part in parts_of(manager.spec, order.element):
                self._is_well(part, term)
        elif isinstance(order, FlyScript | ReleaseTarget):
            self._checks.script_ordered(self._clock.now_ns, term if isinstance(order, FlyScript) else None)
        elif isinstance(order, EnterPhase):
            self._checks.ordered(self._clock.now_ns, order.phase, term)
        elif isinstance(order, SetPriority):
            self._checks.set_priority(self._clock.now_ns, order.function, order.priority)
        return reply

    def clear(self, element: str) -> None:
        """Clear an element as soon as a manager is active."""
        self._well[element] = None
        self._look()

    def latched(self) -> list[str]:
        """Return the elements that the active manager has latched, and the PEs in a long quarantine.

        Elements that the operator has declared failed (`failed`) are left out. The list is empty if no manager is
        active.
        """
        manager = self._managers.commanding
        status = None if manager is None else manager.say(AskStatus()).status
        if status is None:
            return []
        held = {one["element"] for one in status["latched"]}
        held |= {f"pe:{name}" for name, pe in status["pes"].items() if pe["losses"] > 1 and pe["state"] in _AWAY}
        return sorted(held - self._truth.declared.keys())

    def insist(self) -> None:
        """From now on, repeat some orders to each new active manager: declare an element failed, clear an element.

        Only orders that the manager may not know are repeated. With one manager nothing is repeated. Nothing is
        repeated either if no element was declared failed or cleared before this call.
        """
        self._insists = self._managers.are_two and bool(self._truth.declared or self._well)
        self._look()

    def _look(self) -> None:
        """Give the active manager the orders about failed elements that it may not know.

        - An order to clear an element is given if no manager has got it yet.
        - If this operator insists (`insist`), the orders to clear an element, and to declare one failed, are also
          given if the manager has not got them in its present term.

        Look again later if an order to clear an element still waits for an active manager, or if this operator insists.
        """
        manager = self._managers.commanding
        if manager is not None:
            term = manager.core.term
            for element, failed_in in list(self._truth.declared.items()):
                if self._insists and failed_in != term and element not in self._well:
                    self.say(FailElement(element))
            for element, cleared_in in list(self._well.items()):
                if cleared_in == term or not (cleared_in is None or self._insists):
                    continue
                manager.say(ClearElement(element))  # a manager that refuses does not have this element latched
                self._is_well(element, term)
        if self._insists or None in self._well.values():
            self._clock.at(self._clock.now_ns + _AGAIN_NS, self._look)

    def _is_well(self, element: str, term: int) -> None:
        """Record that an element counts as healthy again, after the operator has ordered to clear this element.

        At this time the active manager has no fault of this element latched: it has cleared the fault or had none.
        If the module of the place `element` has failed on all PEs, the oracles and the truth keep the failure.

        term: the term of the active manager.
        """
        if not self._has_failed_everywhere(element):
            everywhere = not self._managers.are_two
            self._checks.cleared(self._clock.now_ns, element, self._truth.situation, everywhere=everywhere)
            if element.startswith("module:"):
                self._truth.is_back(element)
        self._truth.declared.pop(element, None)
        self._well[element] = term

    def _has_failed_everywhere(self, element: str) -> bool:
        """Tell whether an element is a place (`module:NAME@PE`) whose module is down everywhere, and latched."""
        module = module_of(element)
        return is_place(element) and module in self._truth.situation.down and module in self.latched()

    def _excuse_idle(self, element: str) -> None:
        """Allow false reports about the actuators that idle while `element` counts as failed.

        A monitor may find an idle actuator stuck.
        """
        spec = self._checks.spec
        lost = lost_elements(spec, Situation(frozenset({element})))
        for module in spec.modules.values():
            if f"module:{module.name}" in lost or f"device:{module.device}" in lost:
                self._truth.excuse(module.name)
