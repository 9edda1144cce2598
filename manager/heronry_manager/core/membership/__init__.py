"""Membership: which PEs are available to the manager, and what those that are not may still drive.

*What is decided.* `health` decides for each PE whether plans may use it. Its state is the *standing* of the PE:

    WAITING ─► UP ◄─► SUSPECT        available: UP and SUSPECT
       └────► DOWN ◄──────┘          DOWN ─► RETURNING ─► UP: after a hold-down without a gap

`standing` has the table of all changes, and why each happens. `exclusion` decides when something that must never have
two drivers is free: the branches of a DEMUX, and the identifiers of a module that moves. Its state are the *tokens*
that each PE may hold.

*Who may change it.* A standing changes by a frame of the PE, by the time, or by a decision to fail the PE (of `intake`,
which hears what the PE reports, or of the operator). To send a command never changes it. Tokens are gained with the
first ACTIVATE of an epoch (`epochs`), and lost by what the PE reports or by time that has certainly passed.

*What may go wrong.*

    lost       A lost state makes the PE late; the next one makes it UP again. No token becomes free by a lost state
    late       A pause of the manager makes no PE late, since the driver hands over all frames before a deadline. The
               time of a pause frees no token
    doubled    A state counts once: a late or doubled page 0 was dropped before (`epochs.observation`)
    forged     Without a key a forged state keeps a dead PE available, for as long as it is forged. With a key only
               proven states come here (`authentication`)
    restart    All PEs begin as WAITING; quarantines are remembered (`memory`). No token is known, so T_lease counts
               from the first ALIVE for each PE that is not heard

The protocol: docs/protocol/membership.md and docs/protocol/exclusion.md.
"""

from heronry_manager.core.membership.exclusion import Exclusion
from heronry_manager.core.membership.health import Change, Health, HealthChange
from heronry_manager.core.membership.standing import STANDING_TRANSITIONS, Standing

__all__ = ["STANDING_TRANSITIONS", "Change", "Exclusion", "Health", "HealthChange", "Standing"]
