"""An aircraft reaches a new epoch even if changes come fast.

A manager that prepares one epoch after the other must activate one of them. The oracle reads PREPARE and ACTIVATE of
the active manager. A violation is more than `_EPOCHS` epochs prepared in a row, over more than `_STORM_NS`, without one
ACTIVATE. Fewer are allowed, since the manager answers each change by a plan for the newest situation.

Not verified: whether the manager was right to abandon a single epoch.
"""

from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import Activate, ManagementMessage, Prepare

_EPOCHS = 20
_STORM_NS = 2_000_000_000  # twice the time for which a manager answers the newest situation first


class ProgressCheck(Oracle):
    """Counts the epochs that were prepared since the last ACTIVATE."""

    def __init__(self) -> None:
        super().__init__()
        self._epochs: set[int] = set()
        self._since_ns = 0

    def began(self, _t_ns: int) -> None:
        """Count from zero again, since another manager has begun a mastership."""
        self._epochs.clear()

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Count the epoch that a PREPARE opens; at an ACTIVATE count from zero again."""
        if isinstance(message, Activate):
            self._epochs.clear()
        elif isinstance(message, Prepare):
            if not self._epochs:
                self._since_ns = t_ns
            self._epochs.add(message.epoch)
            if len(self._epochs) > _EPOCHS and t_ns - self._since_ns > _STORM_NS:
                story = f"{len(self._epochs)} epochs were prepared in a row, and none was activated"
                self.violations.append(Violation(t_ns, "progress", story, self._since_ns))
                self._epochs.clear()
