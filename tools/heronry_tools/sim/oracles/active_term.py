"""Determines the active term from the frames on the managers' bus: it is the highest term that a command names.

A term stays active until no manager has named it for T_lease. Then the term counts as over: its manager may have died,
or may have been active where no PE heard it. Afterwards the term of the next manager that sends is active.

With a key a PE accepts no command before its TAG. Moreover, a PE that does not know the manager accepts its commands
only in a session, which the PE first has to request. So PEs accept a new term at different times, and the new term is
at first only *claimed*. It becomes active when its manager has sent a second TAG, half a heartbeat period or more after
the first one. Until then PEs may accept the claimed term and the term before it. If no second TAG comes, the term
before stays active.
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS


class ActiveTerm:
    """Finds out which term is active: the managers' commands on the managers' bus name their terms."""

    def __init__(self, spec: Spec, *, has_key: bool = False) -> None:
        self.number = 0
        self.lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns  # T_lease
        self._has_key = has_key
        self._named_ns = 0
        self._answered_ns = self.lease_ns // LEASE_PERIODS // 2
        self._claims: dict[str, tuple[int, int | None]] = {}  # by station: its term, and when its first TAG came

    def named(self, t_ns: int, term: int, station: str = "") -> bool:
        """Record the term that a command names; return whether this term is now active or claimed.

        Returns False only for a term below the active one, while the active one is not over. With a key, a term above
        the active one is at first only claimed. In all other cases the term that the command names is active now.

        station: the manager that has sent the command.
        """
        if term < self.number and t_ns - self._named_ns <= self.lease_ns:
            return False
        if self._has_key and term > self.number:
            if not self.is_claimed(term, station):
                self._claims[station] = term, None
        else:
            self.number, self._named_ns = term, t_ns
        return True

    def tagged(self, t_ns: int, station: str) -> None:
        """Record that the manager at `station` has sent a TAG.

        With a key, the term that this manager claims may become the active term now.
        """
        if station not in self._claims:
            return
        term, first_ns = self._claims[station]
        if first_ns is None:
            self._claims[station] = term, t_ns
        elif term > self.number and t_ns - first_ns >= self._answered_ns:
            self.number, self._named_ns = term, t_ns

    def is_claimed(self, term: int, station: str) -> bool:
        """Tell whether the manager at `station` claims this term, and the term is higher than the active one.

        Such a term is not active yet, since some PEs may still refuse it.
        """
        return term > self.number and self._claims.get(station, (0, 0))[0] == term
