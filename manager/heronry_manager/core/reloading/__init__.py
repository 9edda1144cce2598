"""Reloading: the aircraft changes to another spec without a landing.

*What is decided.* When each PE is brought the table of the other spec, when the epoch is opened by which all PEs change
to it, and when the change is given up. `reload` has the states.

*Who may change it.* The operator orders a reload. Reports of PEs move it on. Whatever changes the situation before the
first step ends it: the old spec flies on, and the operator orders it again.

*What may go wrong.*

    lost       Each transfer goes on or begins anew; each command is repeated
    late       An answer of the driver to a change that was given up is dropped by its number
    doubled    A table that a PE has already is beside once
    forged     With a key tables are sealed, and commands tagged
    restart    What was not activated is forgotten, and the old spec flies on. If the manager dies between the first
               step and the last one, the next one takes all PEs to the spec with which it is started
"""

from heronry_manager.core.reloading.reload import Reloading

__all__ = ["Reloading"]
