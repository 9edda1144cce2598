"""The orders of the operator that can be given now, for all views that give orders: one look at a snapshot.

    fail      an element that does not count as failed
    clear     an element that counts as failed, or a PE that returns from a loss
    retire    an element that works, while no reconfiguration is under way; of a gateway, after the PEs behind it
    restore   a PE that was retired. For other elements `clear` is the same: the manager keeps one fault for each. After
              a take-over, a manager may not know who has latched what: then each place is cleared
    unlock    a PE, if the manager has a key
    kill      the process of a PE in a demo, that may live: one that counts as failed, or is suspect, may
    start     the process of a PE in a demo, that is down

A snapshot may be older than the situation, and some reasons are known to the manager alone. So an order that is offered
may be refused, with a sentence; and none is given without a confirmation.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from heronry_dg.model import Spec
from heronry_dg.situation import elements
from heronry_manager.core.intake import connected_by, parts_of
from heronry_manager.core.situation import HELD_CODE, OPERATOR_CODE
from heronry_tools.watch.snapshot import Snapshot

_WORKS: Final = ("up", "suspect")


@dataclass(frozen=True, slots=True)
class Words:
    """What is said of an order: in a button, and in the question before it; {what} and {to} stand for its names.

    cost: what follows, if the planner cannot tell it.
    """

    word: str
    question: str
    is_grave: bool = False
    cost: str | None = None


ORDERS: Final[Mapping[str, Words]] = {
    "fail": Words("Fail {what}", "Plan without {what}, whatever is heard of it?", is_grave=True),
    "clear": Words("Clear {what}", "Count {what} as working again?"),
    "retire": Words("Retire {what}", "Take {what} out of service, after what runs there has moved?", is_grave=True),
    "restore": Words("Restore {what}", "Take {what} back into service?"),
    "unlock": Words(
        "Unlock {what}",
        "Let other tools write to {what} for a while (NMT, SDO)?",
        is_grave=True,
        cost="No plan changes because of this order. A tool that writes to the PE meanwhile can stop what runs there; "
        "the planner cannot foresee that.",
    ),
    "kill": Words("Kill {what}", "Kill the process of {what} (SIGKILL)?", is_grave=True),
    "start": Words("Start {what} again", "Start the process of {what} again?"),
    "phase": Words("Enter {what}", "Enter the phase {what}?"),
    "priority": Words("Change the priority of {what}", "Give {what} the priority {to}?"),
    "script": Words("Fly the script", "Fly what this script makes of the running configuration, and hold it?", True),
    "release": Words("Release the script", "Hold the script no longer, and seek the best plan again?"),
}
"""The orders, in the order in which views list them."""


class OfferedOrders:
    """Tells which orders can be given now in the system of one spec."""

    def __init__(self, spec: Spec, kinds: Collection[str]) -> None:
        """Offer no other orders than those of `kinds`."""
        self._spec, self._kinds = spec, kinds

    def now(self, view: Snapshot) -> dict[str, list[str]]:
        """Return for each element the orders that can be given to it now; an element without any is left out.

        Under the empty name stand the orders that name no element.
        """
        latched = {fault.element: fault.code for fault in view.faults}
        found = {element: self._of(element, view, latched) for element in elements(self._spec)}
        found |= {element: self._known({"clear": True}) for element in latched if element not in found}  # places
        found[""] = self._known(
            {
                "phase": len(self._spec.phases) > 1,
                "priority": True,
                "script": True,
                "release": view.script.state in ("held", "asked"),
            }
        )
        return {element: orders for element, orders in found.items() if orders}

    def _known(self, offers: Mapping[str, bool]) -> list[str]:
        return [order for order in ORDERS if order in self._kinds and offers.get(order)]

    @cached_property
    def parts(self) -> Mapping[str, tuple[str, ...]]:
        """The elements that count as failed while an element is retired."""
        return {element: parts_of(self._spec, element) for element in elements(self._spec)}

    @cached_property
    def _behind(self) -> Mapping[str, tuple[str, ...]]:
        """The PEs that only an element connects with the manager."""
        return {one: connected_by(self._spec, one) for one in elements(self._spec) if one.startswith(("pe:", "bus:"))}

    def _of(self, element: str, view: Snapshot, latched: Mapping[str, str | None]) -> list[str]:
        is_latched = element in latched
        can_fail = not element.startswith("channel:") and element != f"bus:{self._spec.manager.bus}"
        offers = {
            "fail": can_fail and not is_latched,
            "clear": is_latched or any(one.startswith(f"{element}@") for one in latched),  # a module: on every PE
            "retire": can_fail and not is_latched and self._may_retire(element, view, latched),
        }
        if element.startswith("pe:"):
            standing = view.pes[element.removeprefix("pe:")].standing
            codes = [latched.get(part) for part in self.parts[element]]
            offers |= {
                "clear": is_latched or standing == "returning",
                "retire": offers["retire"] and standing in _WORKS,
                "restore": OPERATOR_CODE in codes and HELD_CODE not in codes,
                "unlock": view.manager.key is not None,
                "kill": standing != "down" or is_latched,
                "start": standing == "down",
            }
        return self._known(offers)

    def _may_retire(self, element: str, view: Snapshot, latched: Mapping[str, str | None]) -> bool:
        """Tell whether an element in service can be retired: nothing is under way, and no PE needs it as its way."""
        if view.stage != "running":
            return False
        parts = self.parts[element]
        behind = (pe for pe in self._behind.get(element, ()) if view.pes[pe].standing != "down")
        return not all(part in latched for part in parts) and all(
            all(part in latched for part in self.parts[f"pe:{pe}"]) for pe in behind
        )
