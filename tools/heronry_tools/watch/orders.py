"""The orders that a view may give, and the way to who carries them out: the manager on its socket, or the demo.

The orders to a manager are those of its socket (`control_protocol`), without their version. The process of a PE is
killed and started by the demo whose manager that is (`process_orders`). Examples:

    order to a manager   {"do": "fail", "what": "pe:nav"}
    order to a manager   {"do": "priority", "what": "imaging", "to": 90}
    order to a manager   {"do": "script", "what": "Guav.PruneEdges ();"}
    order to a manager   {"do": "release"}
    order to a manager   {"do": "restore", "what": "pe:nav"}    takes a retired PE back
    order to a demo      {"do": "kill", "what": "pe:nav"}       "start" starts the process again
"""

import json
from dataclasses import dataclass
from pathlib import Path

from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import ControlError, standby_of
from heronry_manager.shell.control_protocol import ORDER_NAMES, VERSION, Answer, Follow, Spoken, read_order
from heronry_tools.runtime.demo.process_orders import ORDERS as OF_A_DEMO
from heronry_tools.runtime.demo.process_orders import order_demo, takes_orders


@dataclass(frozen=True, slots=True)
class Orders:
    """Gives orders to the manager on a socket, and to the demo whose manager that is.

    manager: the path of the socket; None: no order can be given.
    """

    manager: Path | None

    def kinds(self) -> list[str]:
        """List the kinds of orders that can be given; a demo that has not begun yet gives none."""
        if self.manager is None:
            return []
        return [*ORDER_NAMES, *(OF_A_DEMO if takes_orders(self.manager) else ())]

    def give(self, order: object) -> Answer:
        """Give an order; returns the answer, which may be a refusal. It may take seconds."""
        match order:
            case {"do": str(do), "what": str(what)} if do in OF_A_DEMO and self.manager is not None:
                return order_demo(self.manager, do, what)
            case {"do": str(do), **fields} if do in ORDER_NAMES and self.manager is not None:
                understood = read_order(json.dumps({**fields, "do": do, "v": VERSION}).encode())
                if not isinstance(understood, str | Follow):
                    return _called(self.manager, understood)
            case _:
                pass
        known = ", ".join(self.kinds()) or "none"
        return Answer(done=False, sentence=f"this order cannot be given here; possible are {known}")


def _called(manager: Path, order: Spoken) -> Answer:
    try:
        return call(manager if manager.exists() else standby_of(manager), order)
    except ControlError as error:
        return Answer(done=False, sentence=str(error))
