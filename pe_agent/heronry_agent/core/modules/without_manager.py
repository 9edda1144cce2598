"""What a PE does while no manager is heard (protocol rule 7): it keeps all modules, or stops the expendable ones.

    attended   a LEASE of the highest term came within T_lease
    resting    no such LEASE came within T_lease, and the policy is `safe_mode`. The modules that the slice marks as
               expendable have stopped. The others go on, wired, published and forwarded as before

With the policy `keep` no module is stopped. An expendable module serves nothing critical, and no module that keeps
running reads from it. So a PE can stop its expendable modules by itself: no other PE starts a module in their place.
The PE keeps its configuration, so its state frames report the same state, epoch and digest as before. Only the load in
page 1 becomes smaller.

A LEASE that names the configuration of this PE starts the stopped modules again: it shows that no other configuration
was activated. A LEASE that names another configuration, or none, starts nothing: the manager that sent the LEASE will
decide what this PE runs. A new configuration always starts its modules. In both states an exclusive output still needs
its authorization (protocol rule 6).

One LEASE within T_lease is enough, so single LEASEs may be lost or late. After a pause of the process, the frames that
came in the pause are handled before the deadline of the lease is checked, so a LEASE among them counts. A forged LEASE
can only start modules of the present configuration. After a restart the PE runs nothing.
"""

from heronry_agent.core.authority import FollowedManager
from heronry_agent.core.configuration import ActiveConfiguration, Moves
from heronry_agent.core.modules.running_modules import RunningModules
from heronry_agent.core.turn import Turn
from heronry_wire.sansio import NEVER_NS


class WithoutManager:
    """Stops the expendable modules of one PE while no manager is heard, and starts them again."""

    def __init__(
        self,
        turn: Turn,
        followed_manager: FollowedManager,
        active_configuration: ActiveConfiguration,
        modules: RunningModules,
    ) -> None:
        self._turn, self._followed_manager = turn, followed_manager
        self._active_configuration, self._modules = active_configuration, modules

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`: the end of the lease, if no LEASE comes before that.

        NEVER_NS if no expendable module runs.
        """
        return self._followed_manager.lease_ends_ns if self._active_configuration.expendable_live() else NEVER_NS

    def tick(self) -> None:
        """Stop the expendable modules; the caller has found that the lease has ended."""
        self._move(self._active_configuration.rest())

    def named(self) -> None:
        """Start the expendable modules that `tick` has stopped.

        The caller has heard a LEASE that names the configuration of this PE.
        """
        if self._active_configuration.resting:
            self._move(self._active_configuration.resume())

    def _move(self, moves: Moves) -> None:
        self._modules.carry_out(moves, None)
        self._turn.wants_page_1 = True
