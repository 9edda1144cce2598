"""Which mission phase the aircraft is in, and who may change it.

The first phase of the spec is the one to begin with. It is changed by

    the operator    to any phase
    a module        to any phase: its PE has sent a request (EMCY, PHASE_REQUEST)
    a phase's rule  to a later phase of the spec only; so is a request that a PE makes again for a new reign, after
                    another one has acknowledged it

Whatever changes it, what follows is what follows a fault: a plan for the new phase, an epoch. Of requests that come one
after the other, each counts when it comes; so the last one heard wins, and of rules the latest phase.

A request is repeated until it is acknowledged and carries a number, which its PE counts as long as it lives: one that
comes twice is acknowledged twice and counts once, and so does one that comes after a later one. One from a PE that is
not counted on is neither (nor does a pause lose one): it will be repeated when that PE is back, or not made by anybody
any more. Forged: it changes priorities, and an operator can change them back. A restart goes on with the phase that was
entered last, and so does a standby; the PEs make their requests again, and whoever remembers their numbers, or has
heard them acknowledged, knows that they were obeyed: what the operator has said since stands.
"""

from collections.abc import Mapping

from heronry_dg.model import Spec
from heronry_wire.management import FORWARD_ONLY, REQUEST_NUMBERS


class MissionPhase:
    """The phase that plans are made for."""

    def __init__(self, spec: Spec) -> None:
        self._order = list(spec.phases)
        self._last: dict[str, tuple[int, int]] = {}  # incarnation of each PE, and number of its last request
        self.current = spec.initial_phase()

    def knows(self, index: int) -> bool:
        """Tell whether the spec has such a phase."""
        return index < len(self._order)

    def remember(self, asked: Mapping[str, tuple[int, int]]) -> None:
        """Take up which requests were obeyed: incarnation of each PE, and number of its last request."""
        self._last = dict(asked)

    def accepted(self, pe: str, incarnation: int, detail: int) -> bool:
        """A request of a PE is obeyed, here or elsewhere; tells whether that is news."""
        number = detail & ~FORWARD_ONLY
        last_incarnation, last = self._last.get(pe, (incarnation, number - 1))
        if incarnation == last_incarnation and (last - number) % REQUEST_NUMBERS < REQUEST_NUMBERS // 2:
            return False
        self._last[pe] = incarnation, number
        return True

    def allows(self, index: int, detail: int) -> bool:
        """Tell whether a request changes the phase."""
        if self._order[index] == self.current:
            return False
        return not detail & FORWARD_ONLY or self.current is None or index > self._order.index(self.current)
