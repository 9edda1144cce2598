"""Provisioning: a PE without a table, or with another one and idle, is brought its table; nobody has to type anything.

    table_bringing   which PE waits; when its table goes out; what follows if the PE does not take it
    code_bringing    which PE lacks code; when a bundle goes out; what follows if the PE does not take it
    unknown_nodes    which nodes use a node-ID that the spec does not have
    served_pe        the client of the PE that is being brought something: parts, pauses, UNLOCK
    pace             how fast it goes out, so that nothing that runs misses a deadline

*Who may change it.* A heartbeat of a PE that sends no state frames starts a transfer; only an active manager that may
send brings tables.

*What may go wrong.* A lost segment is sent again. A lost answer ends the transfer, which goes on after a pause that
doubles. Nothing proves an SDO answer or a heartbeat: a forged one delays a transfer or starts one that nobody answers,
and with a key it makes the manager unlock that PE (docs/limits.md). It changes no plan. The PE takes the whole table,
checked, or nothing. A restart of the manager forgets a transfer; the next heartbeat of the PE begins it again, with
what the PE lacks.

No decision on what runs depends on anything here. The pages: docs/canopen.md, docs/protocol.md.
"""

from heronry_manager.core.provisioning.code_bringing import CodeBringing
from heronry_manager.core.provisioning.served_pe import ServedPe
from heronry_manager.core.provisioning.table_bringing import PART_BYTES, TableBringing
from heronry_manager.core.provisioning.unknown_nodes import UnknownNodes

__all__ = ["PART_BYTES", "CodeBringing", "ServedPe", "TableBringing", "UnknownNodes"]
