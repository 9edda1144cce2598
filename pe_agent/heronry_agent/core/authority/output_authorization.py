"""Whether this PE may drive an exclusive output, which no other PE may drive at the same time (protocol rule 6).

Two kinds of output are exclusive: whatever a DEMUX branch does in its steps, and the data frames of a module that may
also run on another PE. They are authorized while the conditions (a) to (d) hold and this PE is not in *doubt*. All of
this is checked before every output with the time of that moment, so that a pause of the process counts.

(a) The last accepted ALIVE names this PE. Before the first ALIVE nothing is authorized: ALIVE follows every LEASE, so a
    PE that has received a configuration has heard an ALIVE. After a new term begins, the last ALIVE of the old term
    remains valid until the first ALIVE of the new term, which comes within a period.

(b) A state frame, LEASE or ALIVE of another node has arrived within the last T_lease. Only these frames count, because
    only they can show, by (a) or (c), that this PE was replaced, for example during a pause of its process. They count
    only on the uplink: the manager considers a gateway that is cut off from the uplink as down, even if the gateway
    hears nodes on its far buses.

(c) This PE is not *overtaken*. It becomes overtaken in two cases:

    - a state frame of another PE, or a LEASE or ACTIVATE at an activation step after PREPARED, names a newer epoch than
      that of this PE;
    - a LEASE or ACTIVATE names the epoch of this PE with another digest.

    It ceases to be overtaken when it takes the last activation step (GO_ALL) of a configuration, or when a LEASE or
    ACTIVATE names its configuration at that step. Before that step another PE, which took over in the meantime, may
    still drive the outputs, even if they are to come back to this PE.

(d) No frame of another node with this PE's node-ID has arrived within the last T_lease: the manager may mistake that
    node for a restart of this PE, and give the outputs of this PE to another PE. With a key the manager cannot make
    that mistake, and this condition is not checked.

*Doubt.* After a silence longer than T_lease this PE is in doubt, and holds its outputs back: another PE may have taken
over, and the first frame after the silence does not show whether one did (docs/protocol/exclusion.md). Two things end
the doubt:

- An ALIVE names this PE and comes from a manager that has brought a configuration to GO_ALL.
- This PE has heard other nodes for T_lease since the silence.

*Data frames of a module that may run elsewhere* have three more rules:

- The limit in (b) is two heartbeat periods for them, and a frame whose transmission could not start by then is dropped.
  The reason: a manager that does not hear this PE gives the identifiers of the module to another PE after three periods
  and a quarter. If this PE is connected again in between, it must hear the manager's decision before it sends.
- A manager that does not receive the state frames of this PE sends PING once in a period. From two periods after the
  first PING on, this PE sends none of these data frames, until an ALIVE comes a period and an eighth or more after the
  last PING.
- When a frame ends (a), (c) or (d), the data frames that wait are withdrawn (`exclusive_frames`). For example, a PE
  whose transmitter had failed has been replaced, and must not send these frames when the transmitter works again.

*Wrong frames.* A lost, late or doubled frame can only withdraw an authorization, never give one. Without a key a forged
LEASE or state frame can hold the outputs back until the next true LEASE, and forged PINGs can hold back the frames of
modules that may run elsewhere. Only a forged ALIVE could release outputs, so the management protocol must be protected.

*With a key*, (c) depends only on frames whose tag proves them: a LEASE or ACTIVATE that is accepted, or one whose tag
was made with the key (`authenticity`). State frames of other PEs do not count, since this PE cannot check their tags.
It does not need them while it hears other nodes: if its outputs were given to another PE, it would hear ALIVEs that do
not name it, and T_lease later LEASEs with the newer epoch, both in every period. After a silence longer than T_lease
this PE may have missed such ALIVEs and LEASEs. So until the doubt ends the state frames of other PEs count, too. A
forger cannot cause such a silence: forged frames only add to the frames that are heard.
"""

from collections.abc import Callable

from heronry_wire.management import is_newer
from heronry_wire.protocol_times import IDENTIFIER_PERIODS, LEASE_PERIODS


class OutputAuthorization:
    """Computes, from the frames that one PE has received, whether its exclusive outputs are authorized."""

    def __init__(self, lease_ns: int, *, revoked: Callable[[], None], has_key: bool = False) -> None:
        """Begin without authorization.

        lease_ns: T_lease, the time within which another node must be heard.
        revoked: called when a frame has ended an authorization.
        has_key: commands are verified with a key.
        """
        self._has_key = has_key
        self._revoked = revoked
        self._lease_ns = lease_ns
        self._identifier_ns = lease_ns * IDENTIFIER_PERIODS // LEASE_PERIODS
        self._named = False
        self._heard_ns: int | None = None
        self._hears_since_ns = 0  # begin of hearing other nodes, at the start or after a silence longer than T_lease
        self._doubted_ns: int | None = None  # the same time while this PE is in doubt; None: no doubt
        self._identifiers_doubted_ns: int | None = None  # the same for data frames, after two silent periods
        self._clashed_ns: int | None = None  # when another node was last heard under this PE's node-ID
        self._overtaken = False
        self._missed_ns: int | None = None  # time of the first PING, while the manager may not hear this PE
        self._pinged_ns = 0  # time of the last PING

    def allows(self, now_ns: int) -> bool:
        """Tell whether exclusive outputs are authorized at this moment."""
        return now_ns <= self.until_ns(now_ns)

    def until_ns(self, now_ns: int) -> int:
        """Time in ns at which the authorization ends if no frame comes.

        It is before `now_ns` if exclusive outputs are not authorized now.
        """
        if not self._named or self._overtaken or self._heard_ns is None:
            return now_ns - 1
        if not self._is_past(self._doubted_ns, now_ns) or not self._is_past(self._clashed_ns, now_ns):
            return now_ns - 1
        return self._heard_ns + self._lease_ns

    def identifiers_until_ns(self, now_ns: int) -> int | None:
        """Time in ns until which data frames of modules that may move to another PE may be sent; None: not now."""
        if not self.allows(now_ns) or self._heard_ns is None or not self._is_past(self._identifiers_doubted_ns, now_ns):
            return None
        since_ns = self._heard_ns if self._missed_ns is None else min(self._heard_ns, self._missed_ns)
        until_ns = since_ns + self._identifier_ns
        return until_ns if now_ns <= until_ns else None

    def heard(self, arrived_ns: int) -> None:
        """Note a state frame, LEASE or ALIVE that arrived on the uplink at `arrived_ns`."""
        last_ns = self._heard_ns
        if last_ns is None or arrived_ns > last_ns:
            self._heard_ns = arrived_ns
            if last_ns is None or arrived_ns - last_ns > self._identifier_ns:
                self._identifiers_doubted_ns = arrived_ns
                if last_ns is None or arrived_ns - last_ns > self._lease_ns:
                    self._doubted_ns = self._hears_since_ns = arrived_ns

    @property
    def heard_ns(self) -> int:
        """When another node was last heard, in ns; 0: none has been heard yet."""
        return 0 if self._heard_ns is None else self._heard_ns

    def hears_since_ns(self, arrived_ns: int) -> int:
        """Time in ns since which other nodes have been heard without a silence longer than T_lease.

        arrived_ns: arrival of the present frame; it is returned if this frame ends such a silence.
        """
        is_silent = self._heard_ns is None or arrived_ns - self._heard_ns > self._lease_ns
        return arrived_ns if is_silent else self._hears_since_ns

    def named(self, is_named: bool, arrived_ns: int, *, has_activated: bool) -> None:
        """Note an ALIVE of the active manager.

        is_named: ALIVE names this PE as available.
        has_activated: this manager has brought a configuration to its last activation step, GO_ALL.
        """
        self.heard(arrived_ns)
        if arrived_ns - self._pinged_ns >= self._identifier_ns * 9 // 16:
            self._missed_ns = None
        was_named, self._named = self._named, is_named
        if is_named and has_activated:
            self._doubted_ns = self._identifiers_doubted_ns = None
        elif was_named and not is_named:
            self._revoked()

    def pinged(self, arrived_ns: int) -> None:
        """Note a PING for this PE: the manager has missed a state frame of this PE."""
        self._pinged_ns = arrived_ns
        if self._missed_ns is None:
            self._missed_ns = arrived_ns

    def _is_past(self, doubted_ns: int | None, now_ns: int) -> bool:
        """Tell whether at least T_lease has passed since a doubt or a clash of node-IDs; None: there was none."""
        return doubted_ns is None or now_ns - doubted_ns >= self._lease_ns

    def clashed(self, arrived_ns: int) -> None:
        """Note that another node has sent a frame under this PE's node-ID; this ends the authorization for T_lease."""
        was_clashed, self._clashed_ns = not self._is_past(self._clashed_ns, arrived_ns), arrived_ns
        if not was_clashed:
            self._revoked()

    def neighbour_runs(self, epoch: int, running: int) -> None:
        """Note that another PE reports `epoch`; this PE is overtaken if its own epoch, `running`, is older.

        With a key, the report counts only while this PE is in doubt.
        """
        if not self._has_key or self._doubted_ns is not None:
            self.saw_epoch(epoch, running)

    def saw_epoch(self, epoch: int, running: int) -> None:
        """Note that `epoch` was activated; this PE is overtaken if its own epoch, `running`, is older."""
        if is_newer(epoch, running):
            self._overtake()

    def contradicted(self) -> None:
        """Note that LEASE or ACTIVATE names this PE's epoch with another digest: this PE is overtaken."""
        self._overtake()

    def confirmed(self) -> None:
        """Note that this PE is not overtaken.

        It takes GO_ALL, or a LEASE or ACTIVATE at GO_ALL names its running configuration.
        """
        self._overtaken = False

    def _overtake(self) -> None:
        if not self._overtaken:
            self._overtaken = True
            self._revoked()
