"""The clock of one node: it was started at its own moment, runs a little fast or slow, and may jump ahead.

A node's monotonic clock never goes back. `ahead_ns` is its lead over virtual time at the start, `ppm` how many
millionths it is fast. It jumps when its machine has slept unnoticed.

The clock is read several times for each frame, so an instant is computed once, and in small numbers.
"""

from random import Random

from heronry_tools.sim.world.clock import Clock

_MILLION = 1_000_000


class LocalClock:
    """Converts virtual time into a node's own, and back."""

    __slots__ = ("_ahead_ns", "_clock", "_ppm", "_read_ns", "_shown_ns", "_since_ns")

    def __init__(self, clock: Clock, ahead_ns: int = 0, ppm: int = 0) -> None:
        self._clock, self._ahead_ns, self._ppm = clock, ahead_ns, ppm
        self._since_ns = clock.now_ns
        self._read_ns = -1  # when it was read last, and (below) what it showed
        self._shown_ns = 0

    def now_ns(self) -> int:
        """What this clock shows now."""
        now_ns = self._clock.now_ns
        if now_ns != self._read_ns:
            elapsed_ns, tick = now_ns - self._since_ns, _MILLION + self._ppm
            passed_ns = elapsed_ns // _MILLION * tick + elapsed_ns % _MILLION * tick // _MILLION
            self._read_ns, self._shown_ns = now_ns, self._since_ns + self._ahead_ns + passed_ns
        return self._shown_ns

    def when_ns(self, local_ns: int) -> int:
        """Virtual instant at which this clock shows at least `local_ns`, if it does not jump."""
        if not self._ppm:
            return local_ns - self._ahead_ns
        passed_ns, tick = local_ns - self._ahead_ns - self._since_ns, _MILLION + self._ppm
        return self._since_ns + passed_ns // tick * _MILLION + (passed_ns % tick * _MILLION + tick - 1) // tick

    def jump(self, ahead_ns: int) -> None:
        """Show `ahead_ns` more from now on."""
        self._ahead_ns += ahead_ns
        self._read_ns = -1


class LocalClocks:
    """Makes the clocks of the nodes of one flight."""

    def __init__(self, clock: Clock, chance: Random, skew_ppm: int) -> None:
        """skew_ppm: the largest error of a clock."""
        self._clock, self._chance, self._skew_ppm = clock, chance, skew_ppm

    def draw(self, apart_ns: int = 0) -> LocalClock:
        """Make a clock with a lead of less than `apart_ns` over virtual time; by default with no lead."""
        ahead_ns = self._chance.randrange(apart_ns) if apart_ns else 0
        return LocalClock(self._clock, ahead_ns, self._chance.randint(-self._skew_ppm, self._skew_ppm))
