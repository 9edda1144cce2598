"""What a PE does while no manager is heard (protocol rule 7): it keeps all modules, or stops the expendable ones.

    attended   a LEASE of the highest term came within T_lease
    resting    none came, and the policy is `safe_mode`: the modules that the slice marks as expendable have stopped;
               the rest goes on, wired, published and forwarded as before

With the policy `keep` no module rests. An expendable module serves nothing critical, so no module that stays reads from
one that stops, and a PE that rests affects no other PE: none starts a module in its place, and none has to agree. The
state frame goes on reporting the same state, epoch and digest: it is the same configuration, of which a part rests;
only the load in page 1 falls.

Back to attended: a LEASE of any active manager that names the very configuration that runs here; it shows that no other
one has been activated. A new configuration starts its modules anyway. A LEASE that names another configuration, or none
yet, starts nothing: its manager will decide. Protocol rule 6 applies throughout: an exclusive output still needs its
authorization.

Lost or late: a LEASE within T_lease is enough. After a pause of the process the frames that waited are taken first, so
a manager that sent one meanwhile has been heard. A forged LEASE can only start modules of the present configuration.
After a restart the PE runs nothing.
"""

from heronry_agent.core.mastership import Mastership
from heronry_agent.core.reconfiguration import Moves, Reconfiguration
from heronry_agent.core.running_modules import RunningModules
from heronry_agent.core.turn import Turn
from heronry_wire.sansio import NEVER_NS


class WithoutManager:
    """Lets the expendable modules of one PE rest while no manager is heard."""

    def __init__(
        self, turn: Turn, mastership: Mastership, reconfiguration: Reconfiguration, modules: RunningModules
    ) -> None:
        self._turn, self._mastership = turn, mastership
        self._reconfiguration, self._modules = reconfiguration, modules

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`, if no LEASE comes before."""
        return self._mastership.lease_ends_ns if self._reconfiguration.expendable_live() else NEVER_NS

    def tick(self) -> None:
        """The lease has run out: stop the expendable modules."""
        self._move(self._reconfiguration.rest())

    def named(self) -> None:
        """A LEASE names the configuration that runs here: start the resting modules."""
        if self._reconfiguration.resting:
            self._move(self._reconfiguration.resume())

    def _move(self, moves: Moves) -> None:
        self._modules.carry_out(moves, None)
        self._turn.wants_page_1 = True
