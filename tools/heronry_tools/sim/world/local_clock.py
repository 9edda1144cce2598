"""The monotonic clock of one node: it differs from virtual time, is a little fast or slow, and may jump ahead.

The clock never goes back. `ahead_ns` is its lead over virtual time at the start. `ppm` is the error of its rate in
millionths; a positive number makes the clock fast. A jump ahead simulates a computer that was suspended while its
programs did not notice it.

The clock is read several times at the same instant, so its time at an instant is computed only once.
"""

from random import Random

from heronry_tools.sim.world.clock import Clock

_MILLION = 1_000_000


class LocalClock:
    """Converts virtual time to the time of a node's clock, and back."""

    __slots__ = ("_ahead_ns", "_clock", "_ppm", "_read_ns", "_shown_ns", "_since_ns")

    def __init__(self, clock: Clock, ahead_ns: int = 0, ppm: int = 0) -> None:
        self._clock, self._ahead_ns, self._ppm = clock, ahead_ns, ppm
        self._since_ns = clock.now_ns
        self._read_ns = -1  # virtual time of the last reading; the reading is below
        self._shown_ns = 0

    def now_ns(self) -> int:
        """Return the present time on this clock."""
        now_ns = self._clock.now_ns
        if now_ns != self._read_ns:
            elapsed_ns, tick = now_ns - self._since_ns, _MILLION + self._ppm
            passed_ns = elapsed_ns // _MILLION * tick + elapsed_ns % _MILLION * tick // _MILLION
            self._read_ns, self._shown_ns = now_ns, self._since_ns + self._ahead_ns + passed_ns
        return self._shown_ns

    def when_ns(self, local_ns: int) -> int:
        """Return the virtual time at which this clock shows at least `local_ns`, if it does not jump until then."""
        if not self._ppm:
            return local_ns - self._ahead_ns
        passed_ns, tick = local_ns - self._ahead_ns - self._since_ns, _MILLION + self._ppm
        return self._since_ns + passed_ns // tick * _MILLION + (passed_ns % tick * _MILLION + tick - 1) // tick

    def jump(self, ahead_ns: int) -> None:
        """Let the clock jump ahead by `ahead_ns`."""
        self._ahead_ns += ahead_ns
        self._read_ns = -1


class LocalClocks:
    """Makes the clocks of the nodes of one flight."""

    def __init__(self, clock: Clock, chance: Random, skew_ppm: int) -> None:
        """Begin without clocks.

        skew_ppm: each clock that `draw` makes is too fast or too slow by at most so many millionths.
        """
        self._clock, self._chance, self._skew_ppm = clock, chance, skew_ppm

    def draw(self, apart_ns: int = 0) -> LocalClock:
        """Return a clock that has a random rate and is ahead of virtual time by a random number of ns.

        apart_ns: this number is less than `apart_ns`; with 0, the clock is not ahead.
        """
        ahead_ns = self._chance.randrange(apart_ns) if apart_ns else 0
        return LocalClock(self._clock, ahead_ns, self._chance.randint(-self._skew_ppm, self._skew_ppm))
