"""A condition that has to last: what tells a fault from two data of different moments."""

_FEWEST = 3


def steps_of(patience_ns: int, period_ns: int) -> int:
    """Give how many steps last for `patience_ns`; three at least."""
    return max(_FEWEST, -(-patience_ns // period_ns))


class Lasting:
    """Counts for how many steps a condition has held without a break."""

    def __init__(self, patience_ns: int, period_ns: int) -> None:
        """A condition counts after `patience_ns` (`steps_of`)."""
        self._enough = steps_of(patience_ns, period_ns)
        self._held = 0

    def is_due(self, holds: bool) -> bool:
        """Take one step; True when the condition has held for long enough, and again after as long.

        Somebody may have cleared meanwhile what was said the first time.
        """
        self._held = self._held + 1 if holds else 0
        return holds and self._held % self._enough == 0
