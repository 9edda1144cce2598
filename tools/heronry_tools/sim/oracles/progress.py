"""Changes do not keep an aircraft from ever reaching an epoch, however fast they come.

A manager that prepares one epoch after the other must activate one of them. The oracle follows PREPARE and ACTIVATE of
the active manager: more than `_EPOCHS` epochs prepared in a row, over more than `_STORM_NS`, without one ACTIVATE, are
a violation. The first of them are allowed: a change is answered by a plan of the newest situation.

Not verified: whether each single epoch was rightly given up.
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
        """Forget what another manager has prepared."""
        self._epochs.clear()

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Follow PREPARE and ACTIVATE."""
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
