"""Which term reigns, as far as anybody can know who hears the managers speak: the highest that is named.

It does until nobody has named it for T_lease: it may have begun where no PE could hear it, and ended there. Then
whoever speaks next reigns.
"""

from heronry_dg.model import Spec
from heronry_wire.management import LEASE_PERIODS


class ReigningTerm:
    """Follows the terms that are named on the managers' bus."""

    def __init__(self, spec: Spec) -> None:
        self.number = 0
        self.lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns  # T_lease
        self._named_ns = 0

    def named(self, t_ns: int, term: int) -> bool:
        """A manager has named its term; tells whether that one reigns."""
        if term < self.number and t_ns - self._named_ns <= self.lease_ns:
            return False
        self.number, self._named_ns = term, t_ns
        return True
