"""The operator of a simulated flight who orders that the aircraft flies by another spec.

waiting     the order is not accepted yet: no manager is active, or the manager refuses it. It is given again after
            `_AGAIN_NS`
under way   a manager has accepted it; the operator looks at its status every `_LOOK_NS`
given up    the status says so, or a manager that has started since does not know of it. It is given again after
            `_AGAIN_NS`, but at most `tries` times in all
over        a manager flies by the other spec, or all tries are used up
"""

from heronry_manager.core.vocabulary import Reply
from heronry_tools.sim.flight.managers import Managers
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.next_spec import NextSpec

_LOOK_NS = 50_000_000
_AGAIN_NS = 1_000_000_000
_LONGEST_NS = 60_000_000_000


class Reloads:
    """Orders the change to one other spec, and follows it."""

    def __init__(self, clock: Clock, managers: Managers, checks: Checks, following: NextSpec) -> None:
        self._clock, self._managers, self._checks = clock, managers, checks
        self._following = following
        self._tries = 0
        self.is_under_way = False
        self.is_done = False
        self.sentences: list[str] = []  # why it was refused or given up, each time

    @property
    def is_over(self) -> bool:
        """Tell whether the aircraft flies by the other spec, or no order will be given any more."""
        return self.is_done or (not self.is_under_way and self._tries == 0)

    def order(self, tries: int = 1) -> None:
        """Order the change now; order it again when it is refused or given up, until it was ordered `tries` times."""
        self._tries = tries
        self._order()

    def order_once(self) -> Reply | None:
        """Order the change now, and return the answer; None: no manager is active."""
        manager = self._managers.commanding
        reply = None if manager is None else manager.reload(self._following)
        if reply is not None and reply.done:
            self._checks.reload_ordered()
            self.is_under_way = True
            self._look()
        elif reply is not None:
            self.sentences.append(reply.sentence)
        return reply

    def fly_through(self) -> None:
        """Simulate until the change is over, for `_LONGEST_NS` at most."""
        end_ns = self._clock.now_ns + _LONGEST_NS
        while not self.is_over and self._clock.now_ns < end_ns:
            self._clock.run_until(self._clock.now_ns + _LOOK_NS)

    def told(self) -> str:
        """Return how the change has ended: `reloaded`, or why it was not done the last time."""
        if self.is_done:
            return "reloaded"
        return self.sentences[-1] if self.sentences else "under way" if self.is_under_way else "not ordered"

    def rest(self) -> None:
        """Order nothing any more; a change that is under way goes on."""
        self._tries = 0

    def _order(self) -> None:
        if self._tries == 0 or self.is_under_way or self.is_done:
            return
        self._tries -= 1
        reply = self.order_once()
        if reply is None or not reply.done:
            self._clock.at(self._clock.now_ns + _AGAIN_NS, self._order)

    def _look(self) -> None:
        """Look how far the change is, as `heronry status` shows it."""
        if not self.is_under_way:
            return
        manager = self._managers.commanding
        if manager is not None:
            status = manager.core.status()["reload"]
            if manager.spec is self._following.spec:
                self.is_under_way, self.is_done = False, True
                self._checks.reload_over(is_given_up=False)
                return
            if status["to"] is None:
                self.is_under_way = False
                self.sentences.append(status["given_up"] or "the manager does not know of the order")
                self._checks.reload_over(is_given_up=True)
                self._clock.at(self._clock.now_ns + _AGAIN_NS, self._order)
                return
        self._clock.at(self._clock.now_ns + _LOOK_NS, self._look)
