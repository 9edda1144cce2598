"""Which mission phase the aircraft is in, and who may change it.

The first phase of the spec is the one to begin with. It is changed by

    the operator    to any phase
    a module        to any phase: its PE has sent a request (EMCY, PHASE_REQUEST)
    a phase's rule  to a later phase of the spec only; so is a request that a PE makes again for a new reign, after
                    another one has acknowledged it

Whatever changes it, what follows is what follows a fault: a plan for the new phase, an epoch. Of requests that come one
after the other, each counts when it comes; so the last one heard wins, and of rules the latest phase.

A request is repeated until it is acknowledged and carries a number: one that comes twice is acknowledged twice and
counts once. One from a PE that is not counted on is neither: it will be repeated when that PE is back, or not made by
anybody any more. Late: it was meant, and still is, or its PE would have taken it back. Forged: it changes priorities,
and an operator can change them back. A restart goes on with the phase that was entered last; the PEs make
their requests again.
"""

from heronry_dg.model import Spec
from heronry_wire.management import FORWARD_ONLY


class MissionPhase:
    """The phase that plans are made for."""

    def __init__(self, spec: Spec) -> None:
        self._order = list(spec.phases)
        self._last: dict[str, int] = {}  # number of the last request of each PE
        self.current = spec.initial_phase()

    def knows(self, index: int) -> bool:
        """Tell whether the spec has such a phase."""
        return index < len(self._order)

    def requested(self, pe: str, index: int, detail: int) -> str | None:
        """A PE asks for a phase; gives it if it is to be entered now."""
        is_new = self._last.get(pe) != detail
        self._last[pe] = detail
        phase = self._order[index]
        if not is_new or phase == self.current:
            return None
        if detail & FORWARD_ONLY and self.current is not None and index < self._order.index(self.current):
            return None
        return phase

    def forget(self, pe: str) -> None:
        """A PE is lost: it may begin to count anew."""
        self._last.pop(pe, None)
