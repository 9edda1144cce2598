"""How much of what one source prints goes to the log: a burst, then a rate, and a size in all."""

_NS_PER_S = 1_000_000_000
_RATE = 4096  # bytes per second
_BURST_S = 16  # the burst is what the rate gives in this time
_ALL_BYTES = 16 * 1024 * 1024


class LogAllowance:
    """What one source may still print: it has what RATE gives in the last seconds, up to a burst, and a size in all."""

    def __init__(self, sources: int, now_ns: int) -> None:
        """Begin with a full burst.

        sources: how many sources share this allowance; each adds 4096 bytes per second, 64 KiB at once, 16 MiB in all.
        """
        self._rate, self._all = sources * _RATE, sources * _ALL_BYTES
        self._left = self._burst = self._rate * _BURST_S
        self._at_ns = now_ns
        self.is_told = False  # whether the log says that something was left out

    @property
    def sentence(self) -> str:
        """Say what is left out of the log."""
        return f"prints more than {self._rate} bytes per second: what is beyond that is left out of the log"

    def take(self, wanted: int, now_ns: int) -> int:
        """Return how many of `wanted` bytes may go to the log now."""
        gained = (now_ns - self._at_ns) * self._rate // _NS_PER_S
        if gained > 0:
            self._left, self._at_ns = min(self._burst, self._left + gained), now_ns
        given = min(wanted, self._left, self._all)
        self._left -= given
        self._all -= given
        return given
