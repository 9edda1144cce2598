"""Which manager a PE follows: that of the highest term heard (protocol rule 7), and whether its lease still runs.

*Term.* A term belongs to the manager that was first heard with it. Two managers never use the same term. So the
PE refuses a command of another manager with this term, and every command with a lower term.

*Lease.* The lease of the manager runs as long as the PE has heard a LEASE of the highest term within the last T_lease.
Here T_lease is that of the slowest bus between the manager and this PE, since LEASE comes at the rate of that bus. If
the lease ends, all modules continue with the policy `keep`, and with the policy `safe_mode` all but the expendable ones
(`without_manager`). The state frames then report that no LEASE is heard, and the standby manager counts these reports.

*Has the manager activated?* A manager that has just become active does not know yet what runs, and which PEs
have released their exclusive outputs. Its first LEASE or ACTIVATE with the step GO_ALL shows that it knows both
(`has_activated`).

*Lost, late, doubled and forged frames.* Up to four LEASEs in a row may be lost within T_lease. A doubled LEASE
has no effect. A late LEASE counts from the time at which it arrived, not from when it is read: a pause of the
process does not prolong a lease. If the PE has a key, `authenticity` refuses forged LEASEs.

*Restart.* The term is kept in memory only. A PE that restarts runs nothing, and follows the first manager that
it hears. This manager may already have been replaced by another one. Then the PE reports an epoch of the
replaced manager. The active manager has not commanded this epoch, and notices that at once.
"""

from heronry_wire.management import MAX_TERM

NO_TERM = 0


class FollowedManager:
    """The highest term heard, the manager that named it, and the time at which the last accepted LEASE came."""

    def __init__(self, lease_ns: int) -> None:
        """Begin without a manager; `lease_ns` is the time in ns for which one LEASE is valid."""
        self.lease_ns = lease_ns
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
        return 0 if self._leased_ns is None else self._leased_ns + self.lease_ns + 1

    def hears_lease(self, now_ns: int) -> bool:
        """Tell whether the last LEASE of the active manager is still valid."""
        return now_ns < self.lease_ends_ns
