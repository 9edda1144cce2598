"""Storms: changes that follow each other so fast that no epoch would ever be activated.

Normally the newest situation is answered first. So a change ends the epoch that is being prepared, or replaces the
request for a plan that is under way. If changes have done this `_RESTARTS` times, over at least `_STORM_NS`, and no
epoch was activated meanwhile, there is a storm.

In a storm changes are gathered. The epoch or request that is under way is finished first. Then one plan answers all
changes that have been gathered. A configuration that is under way is still dropped immediately in two cases:

- it has become illegal (`verify`), for example because a PE or a device that it uses is lost;
- it serves less at level 1 (critical functions) than the running configuration, and the running one is still legal.

A storm is over when an epoch is activated, or when everything runs as planned. A short burst of changes is no storm,
for example when many PEs return together.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.core.turn import Turn

_RESTARTS = 8
_STORM_NS = 1_000_000_000


class Storms:
    """Tells whether there is a storm: changes that follow each other so fast that no epoch is activated.

    Counted are the epochs that a change has ended, and the requests for plans that a change has replaced. The
    count begins anew when an epoch is activated, or when everything runs as planned.
    """

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._spec, self._turn = spec, turn
        self._restarts, self._since_ns = 0, 0

    def ended_one(self) -> None:
        """Count a change that has ended an epoch in preparation, or has replaced a request for a plan."""
        if not self._restarts:
            self._since_ns = self._turn.now_ns
        self._restarts += 1

    def over(self) -> None:
        """Count from zero again, since an epoch was activated or everything runs as planned; this ends a storm."""
        self._restarts = 0

    @property
    def rages(self) -> bool:
        """Tell whether there is a storm: then changes are gathered until the epoch or request under way is finished."""
        return self._restarts >= _RESTARTS and self._turn.now_ns - self._since_ns >= _STORM_NS

    def may_finish(self, now: Situation, wanted: Configuration, running: Configuration | None) -> bool:
        """Tell whether `wanted` may still be deployed, although the situation has become `now`.

        For this, `wanted` must be legal in `now`. If `running` is legal in `now`, too, `wanted` must also serve at
        least as much as `running` at level 1.
        """
        if verify(self._spec, now, wanted):
            return False
        if running is None or verify(self._spec, now, running):
            return True
        before, after = (score(self._spec, now, one, None).critical for one in (running, wanted))
        return after >= before
