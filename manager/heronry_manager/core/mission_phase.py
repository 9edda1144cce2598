"""Which mission phase the aircraft is in, and what may change it.

The spec's first phase is the initial one. It is changed by

    the operator    to any phase
    a module        to any phase: its PE has sent a request (EMCY, PHASE_REQUEST)
    a phase's rule  to a later phase of the spec only; the same holds for a request that a PE makes again in a new
                    mastership, after another manager has acknowledged it

Any change has the consequences of a fault: a plan for the new phase, an epoch. Of requests that come one after the
other, each counts when it comes; so the last one heard wins, and of rules the latest phase.

A request is repeated until it is acknowledged and carries a number, which its PE counts as long as it lives: a request
that comes twice is acknowledged twice and counts once, and so does one that comes after a later one. A request of an
unavailable PE is neither acknowledged nor counted, and none is lost in a pause: the PE repeats it when it is back, or
no longer makes it. Forged: it changes priorities, and an operator can change them back. A manager that restarts or
takes over goes on with the phase that was entered last; the PEs make their requests again, and a manager that remembers
their numbers, or has heard them acknowledged, knows that they were executed: what the operator has ordered since
stands.
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
        """Tell whether the spec has a phase of this index."""
        return index < len(self._order)

    def remember(self, requests: Mapping[str, tuple[int, int]]) -> None:
        """Take up which requests were executed: incarnation of each PE, and number of its last request."""
        self._last = dict(requests)

    def accepted(self, pe: str, incarnation: int, detail: int) -> bool:
        """Note that a request of a PE is executed, here or by another manager; tells whether it is a new one."""
        number = detail & ~FORWARD_ONLY
        last_incarnation, last = self._last.get(pe, (incarnation, number - 1))
        if incarnation == last_incarnation and (last - number) % REQUEST_NUMBERS < REQUEST_NUMBERS // 2:
            return False
        self._last[pe] = incarnation, number
        return True

    def allows(self, index: int, detail: int) -> bool:
        """Tell whether a request for a phase of the spec changes the phase."""
        if self._order[index] == self.current:
            return False
        return not detail & FORWARD_ONLY or self.current is None or index > self._order.index(self.current)
