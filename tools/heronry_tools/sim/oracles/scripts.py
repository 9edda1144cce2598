"""A script of the operator is announced only in the term in which a manager accepted it, and not after its release.

While a script is held, the running configuration may be worse than the best plan at every level except level 1. So the
oracle `end_state` asks here whether a script is held. Only the announcements of the manager (CONTROL, HOLDS) show this.
The manager repeats them; if none has come for `ANNOUNCED_WITHIN_NS`, no script is held.
"""

from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import Control, ElementKind, ManagementMessage, Operation

ANNOUNCED_WITHIN_NS = 2_000_000_000
ON_ITS_WAY_NS = 100_000_000  # an announcement that was queued before the release


class ScriptCheck(Oracle):
    """Records the operator's scripts, and verifies the managers' announcements of scripts."""

    def __init__(self) -> None:
        super().__init__()
        self._ordered_in: int | None = None  # the term that took the last script, unless it was released
        self._released: tuple[int, int] = (0, 0)  # the term in which the last script was released, and until when an
        # announcement of it may be on its way
        self._told_ns: int | None = None

    def script_ordered(self, t_ns: int, term: int | None) -> None:
        """Record that a manager has accepted a script in the term `term`; None: the script was released."""
        if term is None and self._ordered_in is not None:
            self._released = self._ordered_in, t_ns + ON_ITS_WAY_NS
        self._ordered_in = term
        if term is None:
            self._told_ns = None

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """Verify the announcement of a script (HOLDS), and record when it was made."""
        match message:
            case Control(term, _, Operation.HOLDS, ElementKind.SCRIPT) if term == self._ordered_in:
                self._told_ns = t_ns
            case Control(term, _, Operation.HOLDS, ElementKind.SCRIPT) if (
                term == self._released[0] and t_ns < self._released[1]
            ):
                pass
            case Control(term, _, Operation.HOLDS, ElementKind.SCRIPT):
                story = f"{station} announces a script in term {term}, which holds none"
                self.violations.append(Violation(t_ns, "script", story))
            case _:
                pass

    def is_held(self, now_ns: int) -> bool:
        """Tell whether a manager still announces that it holds a script."""
        return self._told_ns is not None and now_ns - self._told_ns < ANNOUNCED_WITHIN_NS
