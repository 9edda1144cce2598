"""Which mission phase the aircraft is in, and what may change it.

The mission begins in the spec's first phase. Three things change the phase:

    the operator    to any phase
    a module        to any phase: its PE has sent a request (EMCY, PHASE_REQUEST)
    a phase's rule  to that phase, and only from the phases that the rule names with `from`; without `from`, from all
                    phases that stand before it in the spec

Any change has the same consequences as a fault: a plan for the new phase, and a new epoch.

*Requests.* A PE numbers its requests from its start on, and repeats a request until it is acknowledged. Each request
counts when it comes, so of several requests the last one wins. If one value satisfies several rules, the PE requests
only one of their phases (`phase_requests` of the agent).

- A request with a number that the manager knows, or with an older number, is acknowledged and has no further effect.
- A request of an unavailable PE is neither acknowledged nor executed. The PE repeats the request when it is available
  again, if it still wants the phase.
- A pause of the manager loses no request.
- A forged request changes the phase, and the operator can change it back.

*New mastership.* A manager that restarts or takes over goes on with the last phase. Each PE then makes its last request
again, even if the previous manager has acknowledged the request. If the new manager remembers the number of the
request, or has heard it acknowledged, the request is not executed again: a later order of the operator stands.
Otherwise the repeated request has effect only in one of two cases:

- Its phase has a rule, and the rule allows the change from the present phase.
- Its phase has no rule, and the present phase stands before it in the spec.
"""

from collections.abc import Mapping

from heronry_dg.model import Spec
from heronry_wire.management import FORWARD_ONLY, REQUEST_NUMBERS


class MissionPhase:
    """Keeps the present mission phase, and decides on requests to change it."""

    def __init__(self, spec: Spec) -> None:
        self._order = list(spec.phases)
        self._origins = [
            self._order[:index] if phase.when is None else phase.when.origins
            for index, phase in enumerate(spec.phases.values())
        ]
        self._last: dict[str, tuple[int, int]] = {}  # incarnation of each PE, and number of its last request
        self.current = spec.initial_phase()

    def knows(self, index: int) -> bool:
        """Tell whether the spec has a phase with this index."""
        return index < len(self._order)

    def remember(self, requests: Mapping[str, tuple[int, int]]) -> None:
        """Restore the last executed request of each PE: the incarnation of the PE, and the number of the request."""
        self._last = dict(requests)

    def accepted(self, pe: str, incarnation: int, detail: int) -> bool:
        """Note that this manager or another one has executed the request for a phase that a PE sent.

        detail: the number of the request, and the flag FORWARD_ONLY, as in the EMCY.

        Returns True if the request was not known before.
        """
        number = detail & ~FORWARD_ONLY
        last_incarnation, last = self._last.get(pe, (incarnation, number - 1))
        if incarnation == last_incarnation and (last - number) % REQUEST_NUMBERS < REQUEST_NUMBERS // 2:
            return False
        self._last[pe] = incarnation, number
        return True

    def allows(self, index: int, detail: int) -> bool:
        """Tell whether a request for the phase with this index may change the current phase.

        detail: the number of the request, and the flag FORWARD_ONLY, as in the EMCY.
        """
        if self._order[index] == self.current:
            return False
        return not detail & FORWARD_ONLY or self.current is None or self.current in self._origins[index]
