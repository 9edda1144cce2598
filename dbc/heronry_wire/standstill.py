"""Measures how late the loop of a driver wakes up, and counts the times in which this process could not run.

A process without a fault may still wake up late: other processes use the processors, the computer swaps, or
a virtual machine is stopped. Then its frames are late, and other nodes may treat its node as lost.

At each turn of its loop the driver measures its lateness. This is the sum of two times: from its last
wake-up until it waits again, and from its deadline until it wakes. The processor time that the driver has
used meanwhile is subtracted from the sum. So the own work of the driver is no standstill, and a call that
blocks, for example on a slow disk, is one. A wait that ends early, because a frame has come, is never late.
The driver gives each standstill to its core as an event.

    up to 1/4 heartbeat period     within the slack of a heartbeat: nothing follows
    more than 1/4                  the standstill is counted
    more than 1 heartbeat period   another node may suspect this one; the core also reports it in an event

The core reports at most one standstill in TELL_AGAIN_NS, unless one is longer than the last one reported.
"""

from dataclasses import dataclass

from heronry_wire.protocol_times import slack_ns

TELL_AGAIN_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class StoodStill:
    """Event: this process was kept from running for `for_ns`, more than a quarter of the uplink's heartbeat period."""

    for_ns: int


@dataclass(slots=True)
class Standstills:
    """Counts the standstills of one process; a *long* one is longer than a heartbeat period of the uplink."""

    period_ns: int  # heartbeat period of the uplink
    times: int = 0  # standstills so far
    long_times: int = 0
    last_long_ns: int = 0  # length of the last long one
    longest_ns: int = 0
    _told_ns: int = 0  # length of the last one that was reported
    _told_at_ns: int = -TELL_AGAIN_NS

    def count(self, one: StoodStill, now_ns: int) -> bool:
        """Count a standstill; tells whether the core is to report it in an event now."""
        self.times += 1
        self.longest_ns = max(self.longest_ns, one.for_ns)
        if one.for_ns <= self.period_ns:
            return False
        self.long_times += 1
        self.last_long_ns = one.for_ns
        if now_ns - self._told_at_ns < TELL_AGAIN_NS and one.for_ns <= self._told_ns:
            return False
        self._told_ns, self._told_at_ns = one.for_ns, now_ns
        return True


class LatenessMeter:
    """Measures how late a driver's loop wakes; it has no clock, and gets all times from the loop."""

    def __init__(self, period_ns: int, now_ns: int, used_ns: int) -> None:
        """Begin to measure at `now_ns`.

        period_ns: heartbeat period of the uplink.
        used_ns: processor time of this thread so far.
        """
        self._slack_ns, self._due_ns = slack_ns(period_ns), now_ns
        self._used_ns, self._woke_ns, self._worked_ns = used_ns, now_ns, 0
        self._is_waiting = False

    def waits(self, due_ns: int | None, now_ns: int | None = None) -> None:
        """Note that the loop begins to wait.

        due_ns: the time at which the wait ends at the latest; None: the wait has no limit, so it cannot be late.
        now_ns: the present time; None: the work of the loop since its last wake-up does not count as lateness,
            since some of this work is meant to take long.
        """
        self._is_waiting = due_ns is not None
        self._worked_ns = 0 if now_ns is None else now_ns - self._woke_ns
        self._due_ns = max(due_ns or 0, now_ns or 0)

    def woke(self, now_ns: int, used_ns: int) -> StoodStill | None:
        """Note that the loop has woken; gives a standstill if the loop woke too late, and None if it did not.

        used_ns: processor time of this thread so far.
        """
        own_ns, self._used_ns = used_ns - self._used_ns, used_ns
        self._woke_ns = now_ns
        late_ns = self._worked_ns + max(0, now_ns - self._due_ns) - own_ns
        return StoodStill(late_ns) if self._is_waiting and late_ns > self._slack_ns else None
