"""Which term reigns, as far as anybody can know who hears the managers speak: the highest that is named.

It does until nobody has named it for T_lease: it may have begun where no PE could hear it, and ended there. Then
whoever speaks next reigns.

With a key nobody believes a command before its TAG. A term is *claimed* until its manager has sent one: so long both it
and the term before may be obeyed, and if no TAG comes the one before goes on.
"""

from heronry_dg.model import Spec
from heronry_wire.management import LEASE_PERIODS


class ReigningTerm:
    """Follows the terms that are named on the managers' bus."""

    def __init__(self, spec: Spec, *, has_key: bool = False) -> None:
        self.number = 0
        self.lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns  # T_lease
        self._has_key = has_key
        self._named_ns = 0
        self._claims: dict[str, int] = {}  # terms that no TAG has followed yet, by station

    def named(self, t_ns: int, term: int, station: str = "") -> bool:
        """A manager has named its term; tells whether that one reigns, or may."""
        if term < self.number and t_ns - self._named_ns <= self.lease_ns:
            return False
        if self._has_key and term > self.number:
            self._claims[station] = term
        else:
            self.number, self._named_ns = term, t_ns
        return True

    def tagged(self, t_ns: int, station: str) -> None:
        """A manager has sent a TAG."""
        term = self._claims.pop(station, 0)
        if term > self.number:
            self.number, self._named_ns = term, t_ns

    def is_claimed(self, term: int, station: str) -> bool:
        """Tell whether nobody can believe yet that this term has begun."""
        return self._claims.get(station) == term
