"""Which term is the active one, as far as a node can know that hears the managers: the highest that is named.

It is active until no manager has named it for T_lease: it may have begun where no PE could hear it, and ended there.
Then the term of the manager that sends next is active.

With a key a PE believes no command before its TAG, and a PE that does not know this manager asks it first, and is
answered. A term is *claimed* until its manager has sent a second TAG, half a period or more after the first: so long
PEs may accept both it and the term before, and if no TAG comes the one before goes on.
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS


class ActiveTerm:
    """Follows the terms that are named on the managers' bus."""

    def __init__(self, spec: Spec, *, has_key: bool = False) -> None:
        self.number = 0
        self.lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns  # T_lease
        self._has_key = has_key
        self._named_ns = 0
        self._answered_ns = self.lease_ns // LEASE_PERIODS // 2
        self._claims: dict[str, tuple[int, int | None]] = {}  # by station: its term, and when its first TAG came

    def named(self, t_ns: int, term: int, station: str = "") -> bool:
        """Follow that a manager has named its term; tells whether that is the active one, or may be."""
        if term < self.number and t_ns - self._named_ns <= self.lease_ns:
            return False
        if self._has_key and term > self.number:
            if not self.is_claimed(term, station):
                self._claims[station] = term, None
        else:
            self.number, self._named_ns = term, t_ns
        return True

    def tagged(self, t_ns: int, station: str) -> None:
        """Follow that a manager has sent a TAG."""
        if station not in self._claims:
            return
        term, first_ns = self._claims[station]
        if first_ns is None:
            self._claims[station] = term, t_ns
        elif term > self.number and t_ns - first_ns >= self._answered_ns:
            self.number, self._named_ns = term, t_ns

    def is_claimed(self, term: int, station: str) -> bool:
        """Tell whether some PEs may not be able to believe yet that this term has begun."""
        return term > self.number and self._claims.get(station, (0, 0))[0] == term
