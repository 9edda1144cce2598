"""A condition that has to last: what tells a fault from two data of different moments."""


class Lasting:
    """Counts for how many steps a condition has held, or not held, without a break."""

    def __init__(self, patience_ns: int, period_ns: int) -> None:
        """A condition counts after `patience_ns`, and after three steps at least."""
        self._enough = max(3, -(-patience_ns // period_ns))
        self._held = self._gone = 0
        self._is_said = False

    def begins(self, holds: bool) -> bool:
        """Take one step; True once, when the condition has held for long enough."""
        self._held = self._held + 1 if holds else 0
        self._gone = 0 if holds else self._gone + 1
        if self._gone >= self._enough:
            self._is_said = False
        if self._is_said or self._held < self._enough:
            return False
        self._is_said = True
        return True
