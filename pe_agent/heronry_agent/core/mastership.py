"""Whom a PE obeys: the manager of the highest term heard (rule 7), and whether it still reigns.

A term belongs to the manager that was first heard with it: the other one cannot have the same, and a command that says
so is as stale as one with a lower term. The lease is heard as long as a LEASE of the reigning term came within T_lease.
Losing it stops nothing (`keep`); it shows in the state frames, where a standby manager counts it. A manager that has
just begun to reign does not know what runs, nor who has let go, until a LEASE or ACTIVATE of its term is at the last
step (`has_activated`).

Lost: T_lease bridges four LEASEs. Doubled: nothing happens twice. Late: it counts from when it arrived here, not from
when it is read, so that a pause is no sign of a manager; one of a lower term is refused. Forged: see `authenticity`.

The term lives in memory. A PE that restarts obeys the first manager it hears: it runs nothing then, and what it is
given by a deposed manager the reigning one sees at once as an unknown epoch.
"""

from heronry_wire.management import MAX_TERM

NO_TERM = 0


class Mastership:
    """Highest term heard, whose it is, and when its last LEASE came."""

    def __init__(self, lease_ns: int) -> None:
        """`lease_ns` is T_lease."""
        self._lease_ns = lease_ns
        self.term = NO_TERM
        self.manager = 0
        self.has_activated = False  # the one that reigns has brought a configuration to its last step
        self._leased_ns: int | None = None

    def admits(self, manager: int, term: int) -> bool:
        """Tell whether to obey a command, and remember its term if it is the highest."""
        if not NO_TERM < term <= MAX_TERM:
            return False
        if term > self.term:
            self.term, self.manager, self.has_activated = term, manager, False
        return term == self.term and manager == self.manager

    def leased(self, arrived_ns: int) -> None:
        """A LEASE was obeyed."""
        self._leased_ns = arrived_ns

    @property
    def lease_ends_ns(self) -> int:
        """From when on no manager is heard, unless another LEASE comes."""
        return 0 if self._leased_ns is None else self._leased_ns + self._lease_ns + 1

    def hears_lease(self, now_ns: int) -> bool:
        """Tell whether the manager reigns, as far as can be heard here."""
        return now_ns < self.lease_ends_ns
