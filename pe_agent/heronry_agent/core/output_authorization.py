"""Whether this PE may drive an exclusive output, which no other PE may drive at the same time (protocol rule 6).

Exclusive outputs are the steps of DEMUX branches and the frames of modules that may run elsewhere. They are authorized
while all four conditions hold. The conditions are checked before every output with the time of that moment, so that a
pause of the process counts:

    (a) the last accepted ALIVE names this PE. Before the first ALIVE nothing is authorized: ALIVE follows every LEASE,
        so a PE that was given a configuration has heard one. A new term does not cancel the last ALIVE of the old
        term; the first ALIVE of the new term, a period later at most, does;
    (b) another node was heard within T_lease, by the arrival of its frame: a state frame, LEASE or ALIVE. No other
        frame counts, because these carry the evidence of (a) and (c): a PE that comes back from a pause must not trust
        a frame that could not have told it that it was replaced. Only frames on the uplink count: the manager takes a
        gateway that is cut off from it for down, even if the gateway hears nodes behind itself;
    (c) no node has been seen on an epoch that this PE should have followed: a newer one in a state frame or in a LEASE
        that says it was activated, or another digest under its own number. The last step of a configuration settles
        that, taken or named by LEASE: until then the PE that took over while this PE was away may not have released
        its outputs, even where this PE is given back what it drove before;
    (d) no other node was heard under this PE's own node-ID within T_lease: the manager may take that node for this
        one, started anew, and give the outputs of this PE to another. With a key the manager does not, and this PE
        does not check it.

A frame of another node after a silence is not evidence enough. A PE that has restarted runs nothing, and another PE
that was cut off as well runs what was given to it before: neither frame would show that this PE was replaced. Nor would
that of a manager that has just become active, and takes every PE that it hears for available. So after a silence that
was too long for (b) this PE is in *doubt*, and holds its outputs back until an ALIVE names it again, of a manager that
has brought a configuration to its last step (before that, the PE that took its place may not have released the
outputs); or, where there is no such manager, until it has heard other nodes for T_lease: the PE that took its place is
among those, and reports its newer epoch every period.

For the frames of a module that may run elsewhere (b) is stricter: two periods, and a frame that could not start by then
does not start at all. A manager that hears nothing of this PE gives its identifiers to another PE after three periods
and a quarter, and a PE whose connection returns in between must not send under them before it has heard what was
decided. Where the frames of this PE do not arrive, the manager sends it PING, once in a period: from two periods after
the first PING on, unless an ALIVE has come a period and an eighth after the last PING, the PE holds these frames back
as well. When a frame ends (a), (c) or (d), the frames that wait to be sent under these identifiers are withdrawn
(`revoked`): a PE whose transmission failed has been replaced, and must not send them when it is heard again.

Lost, late or doubled frames withdraw an authorization at most; they give none. A forged LEASE or state frame can hold
the outputs back until the next true LEASE, and forged PINGs the frames of modules that may run elsewhere; only a forged
ALIVE could release them, so the management protocol must be protected.
"""

from collections.abc import Callable

from heronry_wire.management import is_newer
from heronry_wire.protocol_times import IDENTIFIER_PERIODS, LEASE_PERIODS


class OutputAuthorization:
    """The four conditions of one PE, from the frames that it has heard."""

    def __init__(self, lease_ns: int) -> None:
        """`lease_ns` is T_lease, the time within which another node must be heard."""
        self.revoked: Callable[[], None] = _withdraw_nothing  # called when a frame has ended an authorization
        self._lease_ns = lease_ns
        self._identifier_ns = lease_ns * IDENTIFIER_PERIODS // LEASE_PERIODS
        self._named = False
        self._heard_ns: int | None = None
        self._hears_since_ns = 0  # when it heard another node again after a silence longer than T_lease, or first
        self._doubted_ns: int | None = None  # the same, while this PE is in doubt after that silence
        self._identifiers_doubted_ns: int | None = None  # the same, after a silence longer than two periods
        self._clashed_ns: int | None = None  # when another node was heard under this one's node-ID
        self._overtaken = False
        self._missed_ns: int | None = None  # time of the first PING, if the manager may not have heard this PE since
        self._pinged_ns = 0  # time of the last PING

    def allows(self, now_ns: int) -> bool:
        """Tell whether an exclusive output may be driven at this moment."""
        return now_ns <= self.until_ns(now_ns)

    def until_ns(self, now_ns: int) -> int:
        """Time in ns until which an exclusive output may be driven if no frame comes; before now: not at all."""
        if not self._named or self._overtaken or self._heard_ns is None:
            return now_ns - 1
        if not self._is_past(self._doubted_ns, now_ns) or not self._is_past(self._clashed_ns, now_ns):
            return now_ns - 1
        return self._heard_ns + self._lease_ns

    def identifiers_until_ns(self, now_ns: int) -> int | None:
        """Time in ns until which frames that another PE could send as well may be sent; None: not now."""
        if not self.allows(now_ns) or self._heard_ns is None or not self._is_past(self._identifiers_doubted_ns, now_ns):
            return None
        since_ns = self._heard_ns if self._missed_ns is None else min(self._heard_ns, self._missed_ns)
        until_ns = since_ns + self._identifier_ns
        return until_ns if now_ns <= until_ns else None

    def heard(self, arrived_ns: int) -> None:
        """Take the time of arrival of a state frame, LEASE or ALIVE on the uplink."""
        last_ns = self._heard_ns
        if last_ns is None or arrived_ns > last_ns:
            self._heard_ns = arrived_ns
            if last_ns is None or arrived_ns - last_ns > self._identifier_ns:
                self._identifiers_doubted_ns = arrived_ns
                if last_ns is None or arrived_ns - last_ns > self._lease_ns:
                    self._doubted_ns = self._hears_since_ns = arrived_ns

    def hears_since_ns(self, arrived_ns: int) -> int:
        """Time in ns at which the last silence longer than T_lease ended: now, where the present frame ends it."""
        is_silent = self._heard_ns is None or arrived_ns - self._heard_ns > self._lease_ns
        return arrived_ns if is_silent else self._hears_since_ns

    def named(self, is_named: bool, arrived_ns: int, *, has_activated: bool) -> None:
        """Take an ALIVE of the active manager, which names this PE as available or not.

        has_activated: this manager has brought a configuration to its last step.
        """
        self.heard(arrived_ns)
        if arrived_ns - self._pinged_ns >= self._identifier_ns * 9 // 16:
            self._missed_ns = None
        was_named, self._named = self._named, is_named
        if is_named and has_activated:
            self._doubted_ns = self._identifiers_doubted_ns = None
        elif was_named and not is_named:
            self.revoked()

    def pinged(self, arrived_ns: int) -> None:
        """Take a PING of the manager for this PE: the manager has missed a state frame."""
        self._pinged_ns = arrived_ns
        if self._missed_ns is None:
            self._missed_ns = arrived_ns

    def _is_past(self, doubted_ns: int | None, now_ns: int) -> bool:
        """Tell whether there is no doubt, or no more."""
        return doubted_ns is None or now_ns - doubted_ns >= self._lease_ns

    def clashed(self, arrived_ns: int) -> None:
        """Take a frame of another node with this PE's node-ID."""
        was_clashed, self._clashed_ns = not self._is_past(self._clashed_ns, arrived_ns), arrived_ns
        if not was_clashed:
            self.revoked()

    def saw_epoch(self, epoch: int, running: int) -> None:
        """Take an epoch that another node runs or a manager has activated; one above `running` overtakes this PE."""
        if is_newer(epoch, running):
            self._overtake()

    def contradicted(self) -> None:
        """The manager's epoch has the number of this PE's epoch and is another configuration: this PE is overtaken."""
        self._overtake()

    def confirmed(self) -> None:
        """The last step of a configuration was taken, or named by LEASE again: this PE is not overtaken any more."""
        self._overtaken = False

    def _overtake(self) -> None:
        if not self._overtaken:
            self._overtaken = True
            self.revoked()


def _withdraw_nothing() -> None:
    """Do nothing: before the agent is complete no frame waits."""
