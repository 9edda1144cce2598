"""A condition that has to last before it counts, so that two data of different moments do not look like a fault."""

_FEWEST = 3


def steps_of(patience_ns: int, period_ns: int) -> int:
    """Number of steps in `patience_ns`; never less than three."""
    return max(_FEWEST, -(-patience_ns // period_ns))


class Lasting:
    """Counts for how many steps a condition has held without a break."""

    def __init__(self, patience_ns: int, period_ns: int) -> None:
        """patience_ns: how long the condition has to hold; period_ns: time between two steps."""
        self._enough = steps_of(patience_ns, period_ns)
        self._held = 0

    def is_due(self, holds: bool) -> bool:
        """Count one step; True when the condition has held for `patience_ns`, and after each further `patience_ns`.

        The repetition matters because the operator may have cleared the first report.
        """
        self._held = self._held + 1 if holds else 0
        return holds and self._held % self._enough == 0
