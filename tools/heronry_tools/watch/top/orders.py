"""The orders that `heronry top` gives, the same as the page: which can be given now, and what is asked before."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from heronry_dg.model import Spec
from heronry_tools.watch.offered_orders import ORDERS, OfferedOrders
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.snapshot import Snapshot


@dataclass(frozen=True, slots=True)
class Order:
    """An order that can be given.

    what: the element, phase or function that it names, or the text of a script; empty: it names none.
    to: the priority, as a number; None: that of the spec.
    """

    do: str
    what: str = ""
    to: int | None = None

    def word(self) -> str:
        """Return the order in a few words."""
        return ORDERS[self.do].word.replace("{what}", self.what)

    def question(self) -> str:
        """Return the question that is asked before the order is given."""
        if self.do == "priority" and self.to is None:
            return f"Give {self.what} the priority of the spec again?"
        return ORDERS[self.do].question.replace("{what}", self.what).replace("{to}", str(self.to))


class Operator:
    """Gives orders to a manager on this computer and its demo, and knows which can be given."""

    def __init__(self, spec: Spec, socket: Path) -> None:
        """Give orders to the manager whose socket has the path `socket`."""
        self._spec, self._orders = spec, Orders(socket)
        self._offers = OfferedOrders(spec, self._orders.kinds())

    def offered(self, view: Snapshot, selected: str) -> Iterator[Order]:
        """Yield the orders that can be given now.

        First come those to the selected PE, to its devices, and to the modules that run on it, then those to elements
        that count as failed, then those that name no element, and last those to all other elements.
        """
        offers = self._offers.now(view)
        here = [name for name, device in self._spec.devices.items() if device.pe == selected]
        first = [f"pe:{selected}", *(f"device:{name}" for name in here)]
        first += [f"module:{name}" for name, one in view.modules.items() if one.pe == selected]
        first += [fault.element for fault in view.faults]
        general = offers.pop("", [])
        for element in dict.fromkeys(first):
            yield from (Order(do, element) for do in offers.pop(element, ()))
        yield from (Order("phase", name) for name in self._spec.phases if "phase" in general and name != view.phase)
        yield from (Order("priority", name) for name in self._spec.functions if "priority" in general)
        yield from (Order(do) for do in general if do in ("script", "release"))
        yield from (Order(do, element) for element, orders in offers.items() for do in orders)

    def give(self, order: Order) -> str:
        """Give an order, and return what the manager or the demo answers, or why it does not."""
        return self._orders.give({"do": order.do, "what": order.what, "to": order.to}).sentence
