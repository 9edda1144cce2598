"""The orders that `heronry top` gives: which can be given now, what is asked before, and the way to the manager.

It gives those of the page except scripts, which are files, and orders to a demo, which are only the page's.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from heronry_dg.model import Spec
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import ControlError
from heronry_manager.shell.control_protocol import VERSION, Follow, read_order
from heronry_tools.watch.offered_orders import ORDERS, OfferedOrders
from heronry_tools.watch.snapshot import Snapshot

KINDS: Final = ("fail", "clear", "retire", "restore", "unlock", "phase", "priority", "release")


@dataclass(frozen=True, slots=True)
class Order:
    """An order that can be given.

    what: the element, phase or function that it names; empty: it names none.
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
    """Gives orders to a manager on this computer, and knows which can be given."""

    def __init__(self, spec: Spec, socket: Path) -> None:
        """Give orders to the manager whose socket has the path `socket`."""
        self._spec, self._socket = spec, socket
        self._offers = OfferedOrders(spec, KINDS)

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
        yield from (Order("release") for do in general if do == "release")
        yield from (Order(do, element) for element, orders in offers.items() for do in orders)

    def give(self, order: Order) -> str:
        """Return an order, and return what the manager answers, or why it does not."""
        spoken = read_order(json.dumps({"v": VERSION, "do": order.do, "what": order.what, "to": order.to}).encode())
        assert not isinstance(spoken, str | Follow), "KINDS has orders alone"
        try:
            return call(self._socket, spoken).sentence
        except ControlError as error:
            return str(error)
