"""A term has one manager, and no node goes back to an older term; verified from the managers' bus.

*One manager per term.* LEASE, ALIVE, PREPARE, ACTIVATE, PING and CONTROL name a term. All commands that name the same
term come from the identifiers of one manager. The term of a manager never falls.

Two managers with the same node-ID may use one term, but only for a time: within `_TOGETHER_LEASES` times T_lease each
must notice the other, and one must fall silent. This time does not run in two cases:

- while their bus is broken in the middle: both may then be active in one term, each on its half;
- while the clash of their frames keeps one of them bus-off. If a manager was silent for `_APART_PERIODS` heartbeat
  periods, the time begins anew for this manager.

Without a key a manager notices the other manager by the ALIVE of that manager, with a key only by a TAG of that
manager. So the time for which both have been active is measured from these frames. (Two equal frames sent at once are
one frame on the bus, so neither manager hears the other.)

*No PE goes back.* An epoch belongs to the term that prepared it first, or to the highest term that has adopted it (a
LEASE of this term names the epoch). Within an incarnation a PE never runs an epoch of a lower term after an epoch that
was first prepared in a higher term. Only states that the PE itself sends count: a gateway may forward states in another
order.

*No LEASE goes back.* Within a term LEASE never names an older epoch than a LEASE before it. One case is exempt: between
the two LEASEs the manager has died, has lost its journal, and has found no PE that runs anything. (Other commands may
name an older epoch than LEASE, since they may have waited in the controller.)

*No epoch has two meanings.* If a later term prepares an epoch again, for a PE that joins late, it must use the same
digest. One case is exempt: two managers have copies of one journal (`manager_copied`), and neither can know the numbers
that the other uses.

Only this oracle reads the commands of a deposed manager; all others ignore them (`active_term`).
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.active_term import ActiveTerm
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import NO_EPOCH, Lease, ManagementMessage, Prepare, SliceBody, SliceHead, is_newer

_TOGETHER_LEASES, _APART_PERIODS = 2, 3


class TermCheck(Oracle):
    """Verifies the rules on terms and epochs (head of this file) by the commands and the states of PEs."""

    def __init__(self, spec: Spec, *, has_key: bool = False) -> None:
        super().__init__()
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._manager_of: dict[int, int] = {}  # by term
        self._own: dict[str, int] = {}  # term by station: two stations may share a node-ID
        self._leased: dict[str, tuple[int, int]] = {}  # by station: term and epoch of its last LEASE
        self._has_key, self._is_split, self._bus = has_key, False, spec.manager.bus
        self._mastership = ActiveTerm(spec, has_key=has_key)
        # By epoch: its first PREPARE, and the station that sent it ("" after `manager_copied`).
        self._prepared: dict[int, tuple[str, Prepare]] = {}
        self._adopted: dict[tuple[int, int], int] = {}  # by epoch and digest: the highest term whose LEASE has named it
        self._twins: dict[str, str] = {}  # by station: the other station with the same node-ID
        self._taken: dict[tuple[str, int], tuple[int, int, int]] = {}  # by bus and node: incarnation, epoch, term
        self._voices: dict[int, dict[str, tuple[int, int]]] = {}  # by term and station: first and last time
        self._together_ns = _TOGETHER_LEASES * self._mastership.lease_ns
        self._apart_ns = self._mastership.lease_ns * _APART_PERIODS // LEASE_PERIODS

    def bus_split(self, _t_ns: int, bus: str, is_split: bool) -> None:
        """Record that a bus has broken in the middle, or was repaired.

        While the managers' bus is broken, two managers may use one term. After the repair they again get twice T_lease
        to notice each other.
        """
        if bus == self._bus:
            self._is_split = is_split
            self._voices.clear()

    def follow_command(self, t_ns: int, manager: int, message: ManagementMessage, station: str) -> bool:
        """Verify a command on the managers' bus; return whether its term is active or claimed.

        With a key, a new term is *claimed* as long as it is possible that some PEs do not accept it yet
        (`active_term`).
        """
        if isinstance(message, SliceHead | SliceBody):
            own = self._own.get(station, 0)
            return own == self._mastership.number or self._mastership.is_claimed(own, station)
        term = message.term
        if self._manager_of.setdefault(term, manager) != manager:
            self._tell(t_ns, "mastership", f"managers {self._manager_of[term]} and {manager} both use term {term}")
        if term < self._own.get(station, 0):
            self._tell(t_ns, "mastership", f"manager {manager} went back from term {self._own[station]} to {term}")
        self._own[station] = max(term, self._own.get(station, 0))
        if isinstance(message, Prepare):
            self._prepares(t_ns, station, message)
        elif isinstance(message, Lease) and message.epoch != NO_EPOCH:
            self._leases(t_ns, station, message)
        return self._mastership.named(t_ns, term, station)

    def tagged(self, t_ns: int, station: str) -> None:
        """Record that a station has sent a TAG, which proves the command before it."""
        self._meet(t_ns, station, self._own.get(station, 0))
        self._mastership.tagged(t_ns, station)

    def manager_copied(self, station: str, twin: str) -> None:
        """Note that a second manager is about to start at station `twin`, with a copy of the journal of `station`."""
        self._twins |= {station: twin, twin: station}
        self._prepared = {epoch: ("" if by == twin else by, first) for epoch, (by, first) in self._prepared.items()}

    def follow_alive(self, t_ns: int, station: str, term: int) -> bool:
        """Verify an ALIVE on the managers' bus; return whether its term is active, and not only claimed."""
        if not self._has_key:
            self._meet(t_ns, station, term)
        return self._mastership.named(t_ns, term, station) and not self._mastership.is_claimed(term, station)

    def manager_died(self, _t_ns: int, station: str) -> None:
        """Forget the last LEASE of a station whose manager has died: the station's next LEASE may name any epoch."""
        self._leased.pop(station, None)

    def _leases(self, t_ns: int, station: str, message: Lease) -> None:
        """Verify that a LEASE names no older epoch than the last LEASE of the same station and term."""
        term, before = self._leased.get(station, (message.term, message.epoch))
        if term == message.term and is_newer(before, message.epoch):
            self._tell(t_ns, "mastership", f"{station} goes back from epoch {before} to {message.epoch} in term {term}")
        self._leased[station] = message.term, message.epoch
        named = message.epoch, message.digest
        self._adopted[named] = max(message.term, self._adopted.get(named, 0))

    def _prepares(self, t_ns: int, station: str, message: Prepare) -> None:
        by, first = self._prepared.setdefault(message.epoch, (station, message))
        if first.term == message.term or first.digest == message.digest:
            return
        if by in ("", self._twins.get(station)):
            self._prepared[message.epoch] = station, message
            return
        story = f"epoch {message.epoch} is prepared with one digest in term {message.term}, another in {first.term}"
        self._tell(t_ns, "mastership", story)

    def _meet(self, t_ns: int, station: str, term: int) -> None:
        """Note that a station has used a term at `t_ns`, and verify that it does not share the term for too long.

        It is a violation if several stations have used this term side by side for longer than `_together_ns`. While
        the bus is broken in the middle, nothing is noted or verified.
        """
        if self._is_split:
            return
        voices = self._voices.setdefault(term, {})
        first_ns, last_ns = voices.get(station, (t_ns, t_ns))
        voices[station] = first_ns if t_ns - last_ns <= self._apart_ns else t_ns, t_ns
        if len(voices) == 1:
            return
        firsts_ns, lasts_ns = zip(*voices.values(), strict=True)
        if min(lasts_ns) - max(firsts_ns) > self._together_ns:
            self._tell(t_ns, "mastership", f"{' and '.join(sorted(voices))} both use term {term}")
            voices.clear()

    def said(self, state: StateSaid) -> None:
        """Verify that a PE reports no epoch of a lower term after an epoch of a higher term."""
        bus, node, t_ns, page = state.bus, state.node, state.t_ns, state.page
        if page.epoch not in self._prepared:
            return
        _, prepared = self._prepared[page.epoch]
        term = max(prepared.term, self._adopted.get((page.epoch, prepared.digest), 0))
        incarnation, epoch, before = self._taken.get((bus, node), (page.incarnation, page.epoch, prepared.term))
        if incarnation == page.incarnation and epoch != page.epoch and term < before:
            story = f"{self._pe_of_node[node]} runs epoch {page.epoch} of term {term} after an epoch of term {before}"
            self._tell(t_ns, "term", story)
        self._taken[bus, node] = (page.incarnation, page.epoch, prepared.term)

    def _tell(self, t_ns: int, rule: str, story: str) -> None:
        self.violations.append(Violation(t_ns, rule, story))
