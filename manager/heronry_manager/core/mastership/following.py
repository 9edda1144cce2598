"""A standby manager follows the active one: it listens, learns, and takes over (protocol rule 7).

    following   LEASEs of the highest term come. This manager makes no plan. It keeps, as if it were active itself
                (`memory`): what the active manager announces (phase, latched faults), which PEs are available to the
                active manager, and what the active manager activates
    orphaned    no LEASE came within T_lease, *and* more than half of the PEs that were last available to the active
                manager report that they hear no LEASE either: the active manager is gone, and this manager takes over.
                If only a wire of this manager is broken, the PEs still hear a LEASE, and there is no take-over
                If another spec flies than that of this manager (`flown_spec`), it does not take over
    behind      another manager sends LEASEs with a lower term than a term that was already used, and some PE
                reports that it hears no LEASE: that PE has heard the higher term, and would always refuse these LEASEs.
                For `LEARNS_LEASES` times T_lease this manager learns what the other manager announces; then it takes
                over with a term that all PEs accept

The report of a PE counts for T_lease: five heartbeat periods of the manager's bus or of the PE's uplink, whichever
period is longer.

*No manager was heard yet.* The aircraft may just have been switched on, and manager 126 with it. So this manager first
waits for the start-up window, and then relies on the reports of the PEs. If some PE runs a configuration, the aircraft
flies, and this manager waits for only three times T_lease. A manager 126 that is being started becomes active in that
time.

*Two other managers send.* This manager follows the one with the higher term, and ignores the other one for as long as
LEASEs with the higher term come.

*A manager that only advises* follows an active manager in the same way. It never takes over, and makes its plans for
the situation that it learns of.

*With a key.* LEASE, ALIVE, CONTROL and ACTIVATE count only if their tags are right. PREPARE and slices need no tag,
since the digest in a proven LEASE or ACTIVATE proves them. This digest also serves to check the tags of states.

A state counts if its tag is right. But a manager that was started after the sessions were opened knows no session, so
it can prove no state; and while no manager is active, no session is opened. If unproven states never counted, such a
manager might never take over. So the unproven states of a PE count if the PE has proven none within T_lease. Even then
this manager is orphaned only if it has itself heard no LEASE for T_lease. A forger can make this manager active too
early, but the forger can command nothing. The next mastership waits for the unproven PEs (`unbelieved`), as after a
restart: they prove their states once they have heard the new term.

*Lost, late, doubled and forged frames:*

- A LEASE that only this manager misses leads to no take-over, since the PEs have heard it.
- A late or doubled LEASE has no further effect.
- A forged LEASE keeps this manager quiet for T_lease.
- While the active manager is silent, forged states of more than half of the PEs make this manager take over. Then the
  true manager ends or stands by.
- Forged states can pretend that most PEs refuse a mastership. This only ends the mastership, and a manager that the PEs
  accept begins the next one.
"""

from collections import OrderedDict
from collections.abc import Iterable, Mapping
from functools import partial

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_manager.core.mastership.flown_spec import FlownSpec
from heronry_manager.core.mastership.overheard import Overheard
from heronry_manager.core.membership import Exclusion
from heronry_manager.core.memory import Runs, TermBegun
from heronry_manager.core.situation import Changes, KnownSituation
from heronry_manager.core.tables import Compiler, ContingencyNumbers
from heronry_manager.core.topology import uplink_bus
from heronry_manager.core.turn import Turn
from heronry_wire.management import NO_EPOCH, Alive, Control, ElementKind, Lease, ManagementMessage, Operation
from heronry_wire.protocol_times import ANNOUNCED_EVERY, LEARNS_LEASES, t_lease_ns
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

_DIGESTS_KEPT = 4
_TURNS = 3  # of announcements, in which a script that is held may stay unannounced
_OTHER_FACTS = 2  # that have their turns, beside latched faults and priorities: the phase and the script
_NEVER = 1 << 30
_GOES_FIRST = 3  # times T_lease that a standby manager waits in flight; manager 126 listens for one T_lease


class Following:
    """Follows the active manager: keeps what it announces and deploys, and decides when it is gone."""

    def __init__(
        self,
        spec: Spec,
        turn: Turn,
        situation: KnownSituation,
        exclusion: Exclusion,
        patience_ns: int,
        *,
        compiler: Compiler,
        on_board: ContingencyNumbers | None = None,
    ) -> None:
        """Begin before any LEASE was heard.

        patience_ns: how long this manager waits for the first LEASE before it may take over, in ns from now; at
            most three times T_lease once it has heard that some PE runs a configuration.
        compiler: that of `spec`.
        on_board: the configurations that PREPARE can name by number; None: there are none.
        """
        self._turn, self._situation, self._exclusion = turn, situation, exclusion
        self._lease_ns = t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns)
        self._recent_ns = {
            pe: max(self._lease_ns, t_lease_ns(spec.buses[uplink_bus(spec, pe)].heartbeat_ns)) for pe in spec.pes
        }
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._patience_ns = patience_ns
        self._new_overheard = partial(Overheard, spec, turn, compiler, on_board)
        self._flown = FlownSpec(turn, spec.digest)
        self.forget()

    def forget(self) -> None:
        """Forget every other manager, and what PEs have said of them; wait anew for a LEASE."""
        now_ns = self._turn.now_ns
        self._overheard = self._new_overheard()
        self._flown.forget()
        self._shown: dict[str, tuple[int, int]] = {}  # epoch and digest that each PE shows to run
        self._available: frozenset[str] = frozenset()
        self._said: dict[str, tuple[int, bool]] = {}  # when a PE was believed, and whether it hears a LEASE
        self._unproven: dict[str, tuple[int, bool]] = {}  # the same of PEs that were heard, and not believed
        self._orphaned_ns = now_ns + self._patience_ns  # the PEs count as orphaned no earlier
        self._in_flight_ns = now_ns + _GOES_FIRST * self._lease_ns  # the same, where some PE runs a configuration
        self.node: int | None = None  # the active manager
        self.term = 0
        self.leased_ns: int | None = None  # when its last LEASE came
        self._behind_ns: int | None = None  # since when its term is lower than one that is known
        self._beats_since_script = _NEVER  # since the active manager announced that it holds a script
        self._digests: OrderedDict[int, int] = OrderedDict()  # by epoch, as LEASE named them

    def heard(self, node: int, message: ManagementMessage) -> Changes:
        """Learn from a command of another manager; gives the changes of the situation that the command announces.

        A LEASE counts from any manager, unless its term is lower than that of a LEASE taken within T_lease.
        Every other command counts only if the followed manager sends it. An ALIVE or a CONTROL must also have
        the term of the last LEASE that was taken. While another spec flies, CONTROL announces nothing else.
        """
        if isinstance(message, Lease):
            self._lease(node, message)
        if node != self.node:
            return ()
        match message:
            case Alive(term, _, nodes) if term == self.term:
                self._available = frozenset(self._pe_of_node[n] for n in nodes.intersection(self._pe_of_node))
                self._exclusion.named(self._available, self._turn.now_ns)
                self._beats_since_script += 1
            case Control(term, _, Operation.HOLDS, ElementKind.SCRIPT) if term == self.term:
                self._beats_since_script = 0
            case Control(term, _, Operation.HOLDS, ElementKind.SPEC, mark) if term == self.term:
                self._flown.told(term, mark)
            case Control(term) if term == self.term:
                return self._situation.overheard(node, message) if self._flown.facts_count(term) else ()
            case _:
                self._overheard.take(message)
        return ()

    def held_no_longer(self, node: int, message: ManagementMessage) -> Changes:
        """Drop what the followed manager has ceased to announce, if the message is its ALIVE, which ends a beat.

        Gives the changes of the situation that follow. No effect on the situation while another spec flies.
        """
        if node != self.node or not isinstance(message, Alive) or message.term != self.term:
            return ()
        self._flown.beat(self.term, self._facts())
        if not self._flown.facts_count(self.term):
            return ()
        return self._situation.held_no_longer(node, tells_spec=self._flown.is_announced)

    @property
    def other_spec(self) -> int | None:
        """The mark of the spec that flies, as far as it is heard, if that is another one than this manager's.

        None also if most PEs show that they run what this manager has overheard: its digest names this manager's spec.
        """
        other, runs = self._flown.other, self.runs
        if other is None or runs is None:
            return other
        shown = [self._shown[pe] for pe in self._recently(self._said).keys() & self._shown.keys()]
        return None if 2 * shown.count((runs.epoch, runs.digest)) > len(shown) else other

    def flies_own(self) -> None:
        """Note that this manager becomes active, with its own spec."""
        self._flown.is_own()

    @property
    def preparation(self) -> list[ManagementMessage]:
        """The frames with which the followed manager has prepared its last epoch, for a core of that epoch's spec."""
        return self._overheard.preparation

    def catch_up(self, preparation: Iterable[ManagementMessage]) -> None:
        """Take in how an epoch was prepared, which the core of another spec has heard."""
        for message in preparation:
            self._overheard.take(message)

    def _lease(self, node: int, lease: Lease) -> None:
        now_ns = self._turn.now_ns
        if lease.term < self.term and now_ns < self._orphaned_ns:
            return
        if lease.term > self._turn.memory.term:
            self._turn.keep(TermBegun(lease.term))
        if lease.term == self._turn.memory.term:
            self._behind_ns = None
        elif self._behind_ns is None:
            self._behind_ns = now_ns
        if lease.term != self.term:
            self._beats_since_script = _NEVER  # it ended with its mastership
        self.node, self.term, self.leased_ns = node, lease.term, now_ns
        self._orphaned_ns = now_ns + self._lease_ns + 1
        self._digests[lease.epoch] = lease.digest
        self._digests.move_to_end(lease.epoch)
        if len(self._digests) > _DIGESTS_KEPT:
            self._digests.popitem(last=False)

    @property
    def runs(self) -> Runs | None:
        """The configuration overheard last with its activation, else the one in the memory; None: not known."""
        return self._overheard.runs

    def holds_script(self) -> bool:
        """Tell whether the active manager holds a script of the operator, as far as this manager has heard."""
        return self._beats_since_script <= _TURNS * ANNOUNCED_EVERY * self._facts()

    def _facts(self) -> int:
        return _OTHER_FACTS + self._flown.is_announced + self._situation.fact_count()

    def planned(self, plan: Plan) -> None:
        """Keep a plan that this manager has made: if the active manager deploys it, its slices need not be heard."""
        self._overheard.know(plan.configuration)

    def hears_lease(self) -> bool:
        """Tell whether this manager itself has heard a LEASE within T_lease."""
        return self.leased_ns is not None and self._turn.now_ns < self._orphaned_ns

    def leased_epoch(self) -> int:
        """Return the epoch in the last LEASE if that came within T_lease; NO_EPOCH otherwise."""
        return next(reversed(self._digests)) if self.hears_lease() else NO_EPOCH

    def digest_of(self, epoch: int) -> int | None:
        """Return the digest of an epoch of the active or the previous manager; None: it is not known."""
        return self._digests.get(epoch)

    def state(self, pe: str, page: StatePage0, *, is_proven: bool = True) -> None:
        """Note from page 0 of a PE whether the PE hears a LEASE.

        If this manager follows no manager yet (`node` is None) and the PE is configured, the aircraft is taken to be in
        flight. Then this manager waits for the first LEASE for three times T_lease at most, as `__init__` says.

        is_proven: False: the tag of the page is not valid; such pages are noted apart from the proven ones.
        """
        said = self._said if is_proven else self._unproven
        said[pe] = self._turn.now_ns, PeFlags.HEARS_LEASE in page.flags
        self._shown.pop(pe, None)
        if page.state is not PeState.UNCONFIGURED:
            self._shown[pe] = page.epoch, page.digest
        if self.node is None and page.state is not PeState.UNCONFIGURED:
            self._orphaned_ns = min(self._orphaned_ns, self._in_flight_ns)

    def is_orphaned(self) -> bool:
        """Tell whether this manager may take over.

        This is so in two cases, which the head of this file calls orphaned and behind:

        - No LEASE came within T_lease (before the first LEASE: within the start-up window or, in flight, three times
          T_lease), and more than half of the PEs report that they hear no LEASE either.
        - The term of the followed manager has been too low for `LEARNS_LEASES` times T_lease, and some PE reports that
          it hears no LEASE.

        It is so in no case while another spec flies.
        """
        now_ns = self._turn.now_ns
        if self.other_spec is not None:
            return False
        if self._behind_ns is not None and now_ns - self._behind_ns >= LEARNS_LEASES * self._lease_ns:
            return False in self._heard().values()
        if now_ns < self._orphaned_ns:
            return False
        heard = self._heard()
        reporting = self._available or heard.keys()
        orphans = sum(1 for pe in reporting if heard.get(pe) is False)
        return 2 * orphans > len(reporting)

    def most_hear_none(self) -> bool:
        """Tell whether most of the PEs that are heard, available or not, report that they hear no LEASE."""
        heard = self._heard().values()
        return 2 * sum(not hears for hears in heard) > len(heard)

    def available(self) -> frozenset[str]:
        """Return the PEs that the active manager's last ALIVE has named."""
        return self._available

    def unbelieved(self) -> frozenset[str]:
        """Return the PEs that were heard within T_lease, but have proven no state to this manager in this time.

        If the active manager's last ALIVE has named any PEs, only the PEs that it named are given.
        """
        speak = self._recently(self._unproven).keys() - self._recently(self._said).keys()
        return frozenset(speak & self._available if self._available else speak)

    def _heard(self) -> dict[str, bool]:
        """Return each PE heard within T_lease, and whether it reports that it hears a LEASE."""
        # what was proven counts more than what was not
        return self._recently(self._unproven) | self._recently(self._said)

    def _recently(self, said: Mapping[str, tuple[int, bool]]) -> dict[str, bool]:
        now_ns = self._turn.now_ns
        return {pe: hears for pe, (at_ns, hears) in said.items() if now_ns - at_ns <= self._recent_ns[pe]}

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which the wait for a LEASE ends, so that `is_orphaned` may become true.

        None: this time has passed, so `is_orphaned` may be true already.
        """
        return self._orphaned_ns if self._turn.now_ns < self._orphaned_ns else None
