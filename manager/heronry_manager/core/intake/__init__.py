"""Intake: what follows, in the whole core, from each frame, each order and each change.

*What is decided.* Little: this room knows in which order the other rooms are told, and carries out what they have
decided. It has no state of its own.

    inbound ─► pe_reports ─► reactions           a frame of a PE, what it reports, what follows from that
       └─────► succession                        a command of another manager
    operator_orders                              an order of the operator, and the sentence that answers it

*Who may change it.* Nobody: everything that counts stands in `knowledge` and in `mastership`.

*What may go wrong.* A frame that cannot be decoded, or is not for a manager, has no effect. With a key a frame goes on
only once it is proven (`authentication`). Whether a frame that is lost, late or doubled matters is decided in the room
that gets it: each of these has a table in its head. An order of the operator is answered with one sentence, and an
order that comes twice has no effect the second time.
"""

from heronry_manager.core.intake.inbound import Inbound
from heronry_manager.core.intake.operator_orders import OperatorOrders, module_problem
from heronry_manager.core.intake.pe_reports import PeReports
from heronry_manager.core.intake.reactions import Reactions
from heronry_manager.core.intake.retirement import connected_by, parts_of
from heronry_manager.core.intake.succession import Succession

__all__ = [
    "Inbound",
    "OperatorOrders",
    "PeReports",
    "Reactions",
    "Succession",
    "connected_by",
    "module_problem",
    "parts_of",
]
