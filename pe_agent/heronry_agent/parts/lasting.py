"""A condition that has to last before it counts, so that two data of different moments do not look like a fault."""

_FEWEST = 3


def steps_of(patience_ns: int, period_ns: int) -> int:
    """Number of steps of a module in the time `patience_ns`, rounded up; at least three."""
    return max(_FEWEST, -(-patience_ns // period_ns))


class Lasting:
    """Tells when a condition has held for `patience_ns` without a break."""

    def __init__(self, patience_ns: int, period_ns: int) -> None:
        """Begin with a condition that has not held yet.

        patience_ns: how long the condition has to hold without a break.
        period_ns: time between two calls of `is_due`, which is the period of the module.
        """
        self._enough = steps_of(patience_ns, period_ns)
        self._held = 0

    def is_due(self, holds: bool) -> bool:
        """Note whether the condition holds in this step; tells whether it is to be reported now, or once more."""
        self._held = self._held + 1 if holds else 0
        # once more, since the operator may have cleared the fault after a report
        return holds and self._held % self._enough == 0
