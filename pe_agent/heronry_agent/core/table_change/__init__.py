"""Another table while the PE flies: it comes beside the present one, and a step of an epoch lets the two change places.

    beside       the table beside: it comes, the driver prepares for it, slices of it are staged
    switching    the two tables change places, in one call of the core
    (`core/carried_over`: which modules and sources go on, and what their indices are)

*Who may change it.* The manager brings a table (object 2020h), and activates an epoch of it. A PE takes a table beside
only if its agent was started so that it takes tables.

*What may go wrong.*

    lost       The transfer goes on or begins anew. Without the table beside a PE refuses a slice of it for its digest
    late       A step is taken once. A PE that still flies by the other table when it hears of the epoch takes it then
    doubled    The same table again changes nothing
    forged     With a key a table must be sealed. Without a key anybody can bring one, which changes nothing until an
               epoch of it is activated
    restart    There is no table beside; the driver has kept the one that flies
"""

from heronry_agent.core.table_change.beside import TableBeside
from heronry_agent.core.table_change.switching import TableSwitch

__all__ = ["TableBeside", "TableSwitch"]
