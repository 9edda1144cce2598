"""Reports: what people are told when they ask. No decision depends on anything here.

    manager_status   the state of the whole manager as one document
    pe_details       what PEs store for people to read: why modules failed, how often a computer stood still, which
                     table a PE has

*Who may change it.* An EMCY, a PE that joins or is heard again, or the operator's question starts a reading; only an
active manager that may send reads.

*What may go wrong.* A lost answer ends the try after a second, and a few tries follow. A late, doubled or forged answer
may give a wrong value: SDO proves nothing. That is why the values are for people alone. A restart forgets what was
read, and reads it again when somebody asks.

Events are told where they happen (`turn.emit`), not here. The page: docs/canopen.md.
"""

from heronry_manager.core.reports.manager_status import status
from heronry_manager.core.reports.pe_details import Look, PeDetails

__all__ = ["Look", "PeDetails", "status"]
