"""Which manager a PE follows: that of the highest term heard (protocol rule 7), and whether its lease still runs.

A term belongs to the manager that was first heard with it. Two managers never use the same term, so a command of
another manager with this term is refused, as is a command with a lower term. The *lease* of the manager runs as long as
the last LEASE of the highest term has come within T_lease. Here T_lease is that of the slowest bus between the manager
and this PE, since LEASE comes at the rate of that bus. If the lease ends, modules continue (policy `keep`); the state
frames report that no LEASE is heard, and the standby manager counts these reports. A manager that has just become
active cannot tell yet what runs, and which PEs have released their exclusive outputs. Its first LEASE or ACTIVATE with
the step GO_ALL shows that it can tell both (`has_activated`).

Up to four LEASEs in a row may be lost within T_lease. A doubled LEASE has no effect. A late LEASE counts from its time
of arrival, not from when it is read, so that a pause of the process does not prolong a lease. `authenticity` refuses
forged LEASEs if the PE has a key.

The term is kept in memory only. A PE that restarts runs nothing, and follows the first manager that it hears. This may
be a manager that has already been replaced by another one. The PE then reports the epoch of the replaced manager, and
the active manager notices at once that it has not commanded this epoch.
"""

from heronry_wire.management import MAX_TERM

NO_TERM = 0


class Mastership:
    """The highest term heard, its manager, and when its last LEASE came."""

    def __init__(self, lease_ns: int) -> None:
        """Begin without a manager; `lease_ns` is the time in ns for which one LEASE is valid."""
        self._lease_ns = lease_ns
        self.term = NO_TERM
        self.manager = 0
        self.has_activated = False  # the active manager has brought a configuration to its last step
        self._leased_ns: int | None = None

    def admits(self, manager: int, term: int) -> bool:
        """Tell whether to accept a command of this manager with this term; notes a term that is higher than before."""
        if not NO_TERM < term <= MAX_TERM:
            return False
        if term > self.term:
            self.term, self.manager, self.has_activated = term, manager, False
        return term == self.term and manager == self.manager

    def leased(self, arrived_ns: int) -> None:
        """Note the time of arrival of an accepted LEASE."""
        self._leased_ns = arrived_ns

    @property
    def lease_ends_ns(self) -> int:
        """Time in ns at which the lease ends, unless another LEASE comes; 0 if no LEASE has come yet."""
        return 0 if self._leased_ns is None else self._leased_ns + self._lease_ns + 1

    def hears_lease(self, now_ns: int) -> bool:
        """Tell whether the last LEASE of the active manager is still valid."""
        return now_ns < self.lease_ends_ns
