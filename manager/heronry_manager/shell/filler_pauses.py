"""When the fillers pause: the searches for which the aircraft does not wait.

Fillers are the pre-planner, and the planner while it works only on what was requested in the background. They have a
lower priority than all nodes, which is not enough: a node that wakes on a processor where a search runs comes late, and
its caches are cold. So the fillers do not run at all

    while something is urgent       a PE is suspected, a plan is awaited, or an epoch is on its way
                                    (`ManagerCore.is_pressed`)
    while heartbeats are late       a suspicion shows this, and a standstill of the manager's own process

and for PAUSE_PERIODS heartbeats after that, so that a process is not stopped and continued with every late heartbeat.
On a computer that is always too busy the fillers never run: then faults are met with the plans made before the flight,
and with the greedy planner.
"""

from heronry_wire.sansio import NEVER_NS

PAUSE_PERIODS = 5


class FillerPauses:
    """Decides when the fillers pause; it has no clock."""

    def __init__(self, heartbeat_ns: int) -> None:
        """Begin without a pause; `heartbeat_ns`: the period of the manager's bus."""
        self._after_ns = PAUSE_PERIODS * heartbeat_ns
        self._until_ns = -NEVER_NS
        self.holds = False

    def look(self, now_ns: int, *, is_pressed: bool) -> bool:
        """Tell whether the fillers must not run now.

        is_pressed: whether something is urgent now, or this process has just stood still.
        """
        if is_pressed:
            self._until_ns = now_ns + self._after_ns
        self.holds = now_ns < self._until_ns
        return self.holds

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which to look again at the latest; None: there is no pause."""
        return self._until_ns if self.holds else None
