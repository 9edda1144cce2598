"""Mastership: whether this manager is the active one, and what it learns while it is not.

*What is decided.* `claim` decides when this manager begins a term, gives way, falls silent, or ends:

    LISTENING ─► STARTING ─► ACTIVE        ACTIVE ─► LISTENING: no PE is heard, or most refuse the term
        │            │          │
        └────────────┴──────────┴─► STANDBY or RETIRED: another manager has precedence

`following` decides when a manager that stands by may take over: *following* while LEASEs come, *orphaned* when most PEs
hear none either, *behind* when a PE refuses the followed manager. `overheard` puts together the configuration that the
other manager has activated, and `flown_spec` keeps which spec flies.

*Who may change it.* Only `claim` moves the state, by rows of its table. `intake.succession` asks it, and carries out
what follows for the rest of the core. LEASEs of other managers and reports of PEs are the only evidence; that this
manager has sent something is none.

*What may go wrong.*

    lost       A LEASE that only this manager misses leads to no take-over, since the PEs have heard it
    late       A late LEASE makes no manager give way twice. A pause makes no manager orphaned: frames come first
    doubled    A doubled LEASE has no further effect. A second manager with the same node-ID and term gives way
    forged     Without a key two LEASEs within T_lease can end a mastership, and forged states of most PEs can make a
               standby manager take over while the active one is silent. With a key only proven commands count
    restart    It begins with LISTENING; the terms that were used are remembered (`memory`)

The protocol: docs/protocol/mastership.md.
"""

from heronry_manager.core.mastership.claim import MASTERSHIP_TRANSITIONS, Claim, Mastership
from heronry_manager.core.mastership.following import Following

__all__ = ["MASTERSHIP_TRANSITIONS", "Claim", "Following", "Mastership"]
