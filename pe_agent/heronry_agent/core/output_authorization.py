"""Whether this PE may drive what nobody else may drive at the same time (rule 6).

Exclusive outputs are the steps of DEMUX branches and the frames of modules that may run elsewhere. They are allowed
while all four hold, asked before every output with the time of that moment, so that a pause of the process counts:

    (a) the last ALIVE that was obeyed names this PE. Before the first one nothing is allowed: it follows every LEASE,
        so whoever was given a configuration has heard it. A new term does not cancel the word of the old one; its
        own first ALIVE, a period later at most, does;
    (b) another node was heard within T_lease, by when its frame arrived: a state frame, LEASE or ALIVE. Those alone
        count, because they carry the evidence of (a) and (c): a PE that comes back from a pause must not trust a frame
        that could not have told it that it was replaced. They count on the uplink alone: a gateway that is cut off
        from the manager counts as down there, whatever it hears behind itself;
    (c) no node has been seen on an epoch that this PE should have followed: a newer one in a state frame or in a LEASE
        that says it was activated, or another digest under its own number. The last step of a configuration settles
        that, taken or named by LEASE: until then whoever took over while this PE was away may not have let go, even
        where it is given back what it drove before;

    (d) nobody else was heard under this PE's own node-ID within T_lease: the manager may take that node for this one,
        started anew, and give away what it holds here. With a key it does not, and neither does this PE.

Hearing somebody again after a silence is no such proof. A PE that has restarted runs nothing, and one that was cut off
as well runs what was given to it before: neither could tell. Nor could a manager that has only begun to reign, and
counts on whoever it hears. So after a silence that was too long for (b) this PE is in *doubt*, and holds back until an
ALIVE names it again, of a manager that has brought a configuration to its last step (before, who took its place may not
have let go); or, where there is none, until it has heard others for T_lease: whoever took its place is among those, and
tells its newer epoch every period.

For the frames of a module that may run elsewhere (b) is stricter: two periods, and a frame that could not start by then
does not start at all. A manager that hears nothing of this PE gives its identifiers away after three periods and a
quarter, and a PE whose wire is mended in between must not send under them before it has heard what was decided. Where
it is the PE that is not heard, the manager asks it (PING), once in a period: two periods after the first of these,
unless an ALIVE has come a period and an eighth after the last, it holds them back as well. What waits to be sent under
them when a word ends (a), (c) or (d) is withdrawn (`revoked`): a PE that hears and is not heard has been replaced, and
must not send it when it is heard again.

Lost, late or doubled frames make it more cautious at most. A forged LEASE or state frame can hold the outputs until
the next true LEASE, and forged PINGs those frames; only a forged ALIVE could release them, and the management protocol
is what must be protected.
"""

from collections.abc import Callable

from heronry_wire.management import is_newer
from heronry_wire.protocol_times import IDENTIFIER_PERIODS, LEASE_PERIODS


class OutputAuthorization:
    """The four conditions, as last heard."""

    def __init__(self, lease_ns: int) -> None:
        """`lease_ns` is T_lease, the time within which another node must be heard."""
        self.revoked: Callable[[], None] = _nobody_minds  # called when a word has ended what may be sent
        self._lease_ns = lease_ns
        self._identifier_ns = lease_ns * IDENTIFIER_PERIODS // LEASE_PERIODS
        self._named = False
        self._heard_ns: int | None = None
        self._hears_since_ns = 0  # when it heard somebody again after a silence longer than T_lease, or first
        self._doubted_ns: int | None = None  # since when it hears others again, after a silence longer than T_lease
        self._identifiers_doubted_ns: int | None = None  # the same, longer than two periods
        self._clashed_ns: int | None = None  # when another node was heard under this one's node-ID
        self._overtaken = False
        self._missed_ns: int | None = None  # when the manager asked for this PE first, if it may not have heard it yet
        self._asked_ns = 0  # ... and last

    def allows(self, now_ns: int) -> bool:
        """Tell whether an exclusive output may be driven at this moment."""
        return now_ns <= self.until_ns(now_ns)

    def until_ns(self, now_ns: int) -> int:
        """Until when one may be driven, as things stand now; a time before now: not at all."""
        if not self._named or self._overtaken or self._heard_ns is None:
            return now_ns - 1
        if not self._is_past(self._doubted_ns, now_ns) or not self._is_past(self._clashed_ns, now_ns):
            return now_ns - 1
        return self._heard_ns + self._lease_ns

    def identifiers_until_ns(self, now_ns: int) -> int | None:
        """Until when frames may be sent that another PE could send as well; None: not now."""
        if not self.allows(now_ns) or self._heard_ns is None or not self._is_past(self._identifiers_doubted_ns, now_ns):
            return None
        since_ns = self._heard_ns if self._missed_ns is None else min(self._heard_ns, self._missed_ns)
        until_ns = since_ns + self._identifier_ns
        return until_ns if now_ns <= until_ns else None

    def heard(self, arrived_ns: int) -> None:
        """Another node, or a manager, was heard on the uplink."""
        last_ns = self._heard_ns
        if last_ns is None or arrived_ns > last_ns:
            self._heard_ns = arrived_ns
            if last_ns is None or arrived_ns - last_ns > self._identifier_ns:
                self._identifiers_doubted_ns = arrived_ns
                if last_ns is None or arrived_ns - last_ns > self._lease_ns:
                    self._doubted_ns = self._hears_since_ns = arrived_ns

    def hears_since_ns(self, arrived_ns: int) -> int:
        """Give when the last silence longer than T_lease has ended: now, where it ends with what has just arrived."""
        is_silent = self._heard_ns is None or arrived_ns - self._heard_ns > self._lease_ns
        return arrived_ns if is_silent else self._hears_since_ns

    def named(self, is_named: bool, arrived_ns: int, *, by_who_knows: bool) -> None:
        """ALIVE of the reigning manager counts on this PE, or does not; it is heard like any other frame.

        by_who_knows: this manager has brought a configuration to its last step.
        """
        self.heard(arrived_ns)
        if arrived_ns - self._asked_ns >= self._identifier_ns * 9 // 16:
            self._missed_ns = None
        was_named, self._named = self._named, is_named
        if is_named and by_who_knows:
            self._doubted_ns = self._identifiers_doubted_ns = None
        elif was_named and not is_named:
            self.revoked()

    def asked(self, arrived_ns: int) -> None:
        """The manager asks for a state of this PE: it has missed one."""
        self._asked_ns = arrived_ns
        if self._missed_ns is None:
            self._missed_ns = arrived_ns

    def _is_past(self, doubted_ns: int | None, now_ns: int) -> bool:
        """Tell whether there is no doubt, or no more."""
        return doubted_ns is None or now_ns - doubted_ns >= self._lease_ns

    def clashed(self, arrived_ns: int) -> None:
        """Another node speaks under this one's node-ID."""
        was_clashed, self._clashed_ns = not self._is_past(self._clashed_ns, arrived_ns), arrived_ns
        if not was_clashed:
            self.revoked()

    def saw_epoch(self, epoch: int, running: int) -> None:
        """Another node runs, or a manager has activated, an epoch."""
        if is_newer(epoch, running):
            self._overtake()

    def contradicted(self) -> None:
        """The manager's epoch has the number of ours and is another configuration."""
        self._overtake()

    def confirmed(self) -> None:
        """The last step of a configuration was taken, or named by the manager once more."""
        self._overtaken = False

    def _overtake(self) -> None:
        if not self._overtaken:
            self._overtaken = True
            self.revoked()


def _nobody_minds() -> None:
    """Nothing waits anywhere."""
