"""A condition that has to last, so that two data of different moments do not look like a fault."""

_FEWEST = 3


def steps_of(patience_ns: int, period_ns: int) -> int:
    """Give the number of steps in `patience_ns`; three at least."""
    return max(_FEWEST, -(-patience_ns // period_ns))


class Lasting:
    """Counts for how many steps a condition has held without a break."""

    def __init__(self, patience_ns: int, period_ns: int) -> None:
        """The condition is due after `patience_ns` (`steps_of`)."""
        self._enough = steps_of(patience_ns, period_ns)
        self._held = 0

    def is_due(self, holds: bool) -> bool:
        """Take one step; True when the condition has held for long enough, and again after as long.

        The operator may have cleared the first report meanwhile.
        """
        self._held = self._held + 1 if holds else 0
        return holds and self._held % self._enough == 0
