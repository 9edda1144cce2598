"""What a PE does while no manager is heard (rule 7): it keeps what it runs, or lets go of what is not critical.

    attended   a LEASE of the reigning term came within T_lease
    resting    it did not, and the policy is `safe_mode`: the modules that the slice marks as expendable have stopped;
               the rest goes on, wired, published and forwarded as before

With `keep` nothing ever rests. Expendable is what serves nothing critical, so nothing that stays reads from what stops,
and whether a PE rests concerns nobody else: no other PE starts anything for it, and none has to agree. The state frame
goes on telling the same state, epoch and digest: it is the same configuration, of which a part rests; only the load of
page 1 falls.

Back to attended: a LEASE that names the very configuration that runs here, whoever reigns by then; it says that nothing
else has been activated. A new configuration starts what it wants anyway. A LEASE that names anything else, or nothing
yet, starts nothing: its manager will decide. Rule 6 stands above all of this: what is exclusive asks for its permission
as ever.

What if: a LEASE that is lost or late within T_lease is not missed. After a pause of the process the frames that waited
are taken first, so a manager that spoke meanwhile has been heard. A forged LEASE can start what may run anyhow. A
restart forgets all, and runs nothing.
"""

from heronry_agent.core.mastership import Mastership
from heronry_agent.core.reconfiguration import Moves, Reconfiguration
from heronry_agent.core.running_modules import RunningModules
from heronry_agent.core.turn import Turn
from heronry_wire.sansio import NEVER_NS


class WithoutManager:
    """Lets the expendable rest while no manager is heard."""

    def __init__(
        self, turn: Turn, mastership: Mastership, reconfiguration: Reconfiguration, modules: RunningModules
    ) -> None:
        self._turn, self._mastership = turn, mastership
        self._reconfiguration, self._modules = reconfiguration, modules

    @property
    def next_ns(self) -> int:
        """When to call `tick`, if no LEASE comes before."""
        return self._mastership.lease_ends_ns if self._reconfiguration.expendable_live() else NEVER_NS

    def tick(self) -> None:
        """The lease has run out."""
        self._move(self._reconfiguration.rest())

    def named(self) -> None:
        """A LEASE names the configuration that runs here."""
        if self._reconfiguration.resting:
            self._move(self._reconfiguration.resume())

    def _move(self, moves: Moves) -> None:
        self._modules.carry_out(moves, None)
        self._turn.wants_page_1 = True
