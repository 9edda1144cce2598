"""Tables: what names mean on the wire, for a whole spec and for one configuration. A pure computation, without state.

    compilation            the table of each PE, and the slices of a configuration: indices of that table
    contingency_numbers    the numbers of the contingencies that fit into a PE's table, so that PREPARE need not be
                           followed by slices

A table is given to its PE before the flight; a slice goes over the bus. The digest of a slice covers the identity of
the table, and the digest of a configuration covers all its slices. So a PE that has another table stages nothing, and
says so: nothing here has to be agreed on beforehand, and a restart computes the same again.

The protocol: docs/protocol/growth.md and docs/protocol/reconfiguration.md.
"""

from heronry_manager.core.tables.compilation import CompiledConfiguration, Compiler
from heronry_manager.core.tables.contingency_numbers import ContingencyNumbers, PeTables, loaded, on_board

__all__ = ["CompiledConfiguration", "Compiler", "ContingencyNumbers", "PeTables", "loaded", "on_board"]
