"""Which readings of a sensor are valid, and when a device has failed (semantics, the row *device*).

A reading is valid if its driver gives a value, each number in it is finite, a single number is inside `range`
(inclusive), and it is not older than `stale_ms` by its own time. A sensor that was never read has no valid reading.

    settling    from the start of the process, for as long as the driver declares: nothing is reported
    giving      there was a valid reading within the last `stale_ms`
    failed      there was none for `stale_ms`. A valid reading makes the sensor giving again; the manager's fault stays
                until the operator clears it

After a standstill of the agent everything seems to be old. So nothing counts as failed until the agent has been awake
for as long as the deadline is.
"""

import math
from dataclasses import dataclass

from heronry_agent.device import Reading
from heronry_agent.module import Value
from heronry_agent.shell.device_processes.shared_block import Entry

STOOD_STILL_NS = 200_000_000
_FUTURE_NS = 50_000_000  # the agent's time of a turn may be this much older than a reading
_NOTHING = Reading(None, 0, valid=False)


def is_inside(value: Value, least: float | None, most: float | None) -> bool:
    """Tell whether a value can be used: a float is finite, and a number is in a range, inclusive."""
    if not isinstance(value, (int, float)):
        return True
    return math.isfinite(value) and (least is None or value >= least) and (most is None or value <= most)


@dataclass(frozen=True, slots=True)
class ReadingRule:
    """What a reading must fulfil."""

    stale_ns: int
    least: float | None = None
    most: float | None = None

    def judge(self, entry: Entry | None, now_ns: int) -> Reading:
        """Return the reading that an entry of the shared memory is."""
        if entry is None or entry.value is None:
            return _NOTHING
        is_in_time = -_FUTURE_NS <= now_ns - entry.time_ns <= self.stale_ns
        return Reading(entry.value, entry.time_ns, is_in_time and is_inside(entry.value, self.least, self.most))


class Silence:
    """Knows since when a device owes a sign: a valid reading, or the execution of a command."""

    def __init__(self, allowed_ns: int, settles_ns: int, now_ns: int) -> None:
        """Begin to settle.

        allowed_ns: the device has failed if it gives no sign for so long.
        settles_ns: before the first sign it may take so long.
        """
        self._allowed_ns = allowed_ns
        self._due_ns = now_ns + max(settles_ns, allowed_ns)
        self._looked_ns = self._awake_ns = now_ns  # the latter: since when the agent has not stood still

    def sign(self, at_ns: int) -> None:
        """Note a sign of the device, or that it owes none since `at_ns`."""
        self._due_ns = max(at_ns, self._awake_ns) + self._allowed_ns

    def look(self, now_ns: int) -> None:
        """Note that the agent is awake; call this in every turn of its loop."""
        if now_ns - self._looked_ns > STOOD_STILL_NS:
            self._awake_ns = now_ns
            self._due_ns = max(self._due_ns, now_ns + self._allowed_ns)
        self._looked_ns = now_ns

    def is_over(self, now_ns: int) -> bool:
        """Tell whether the device has failed."""
        return now_ns > self._due_ns
