"""The manager's core: health in, plans asked for, epochs out. No clock, socket, solver or file.

The loop of its life: *health* says which PEs are counted on; together with the latched faults that is the *situation*.
When the situation changes, a plan is asked for (`RequestPlan`, answered by `PlanReady` or `PlanFailed`, stamped, so
that an answer to an older question is dropped). A plan becomes an epoch (`Reconfiguration`), and the epoch becomes what
runs.

Desired, commanded and observed stay apart: a plan is desired; `self._current` is the last epoch whose ACTIVATE went
out; only state frames write what a PE is seen to run.

    LISTENING   for T_lease: a LEASE heard now means another manager, and this one does not start. Also, and until
                somebody is heard again, whoever reigned and hears no PE any more: it is deaf, or its wire is broken,
                and what it would still say could only take things away from who hears it. So does one that most PEs
                refuse: they are heard, and say that they hear no LEASE, because they know of a higher term; each time
                it has been refused before it stays for twice as long. The next term may be high enough; where two are
                not, the journal that knew them may be lost, and once in its life a manager leaps over many
    STARTING    LEASE and ALIVE go out; waiting for every PE, or for the start-up window to close
    REIGNING    everything else
    STANDBY     another manager reigns: this one follows (`following`) and takes over when the PEs hear none any more
    RETIRED     the same, without `standby`: silent for ever

With `standby` a manager that hears another one, at its start or later with a higher term, stands by instead of ending:
it forgets all but its memory, and learns from the bus. Manager 127 also stands by where it hears nobody at its start,
for a while (`following`), so that 126 goes first. One that hears a LEASE of its own number and term has a double, which
was started by mistake: whoever hears the other one first gives way.

A mission phase that is asked for, and an element that the operator fails or clears, change the situation like a fault.

With `advise` it says nothing on the bus, ever: it plans as if it reigned, tells what it would do (`advice`), and takes
it for done where the PEs are seen to do just that. It may sit beside a manager that reigns: then it takes in what that
one holds and activates, as a standby does (`following`), and listens for longer at its start, since facts are told in
turn. Where PEs run what it has not overheard, and would not plan either, it says so, and advises nothing.

A fault while an epoch is being prepared abandons its number. A fault after the first ACTIVATE leaves the epoch standing
(LEASE goes on repeating its step) until the next one is ready to take its place. A manager that was paused finds frames
and deadlines waiting: the driver gives it the frames first.

What a restart does: a new term, then the same start as ever, with all that is remembered (`memory`, kept by the driver
in the journal): the phase, latched faults, quarantines, what runs. PEs go on with what they run. Where that is known it
is adopted; and where it can stay as it is, the best plan is asked for at leisure, and anything else is a fault that has
just been found. Where it is not known, a plan is asked for, which may turn out to be what runs.
"""

from collections.abc import Iterable
from enum import Enum
from typing import Any

from heronry_dg.model import Spec
from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.plan import Plan
from heronry_dg.verify import verify
from heronry_manager.contingency.on_board import ContingencyNumbers
from heronry_manager.core.announcing import Announcer, Fact
from heronry_manager.core.authenticity import Authenticity
from heronry_manager.core.beacon import Beacon
from heronry_manager.core.deployment import Deployment
from heronry_manager.core.exclusion import Exclusion
from heronry_manager.core.following import Following
from heronry_manager.core.health import Change, Health, HealthChange, Standing
from heronry_manager.core.known_situation import KnownSituation
from heronry_manager.core.memory import Memory, Quarantined, Released, TermBegun
from heronry_manager.core.numbering import NoTermError, next_term
from heronry_manager.core.operator_orders import OperatorOrders
from heronry_manager.core.planning import Planning
from heronry_manager.core.reconfiguration import Cause
from heronry_manager.core.status import status
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import (
    AliveLeft,
    AskStatus,
    ChannelsLost,
    JournalTold,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    PlanFailed,
    PlanReady,
    Reply,
    Settled,
    Stop,
)
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import REQUEST_ID, IdentificationService
from heronry_wire.identifiers import FIRST_MANAGER, MANAGER_NODES, Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    decode_command,
    decode_emergency,
)
from heronry_wire.protocol_times import LEARNS_LEASES, START_UP_WINDOW_NS, late_ns, t_lease_ns
from heronry_wire.sansio import NEVER_NS, Received, Tick, require
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    StatePage,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
)

_EVERYBODY = 0
_MOST_DOUBLINGS = 9
_LEAPS_AFTER, _LEAP = 2, 256  # reigns that were refused one after the other; terms
_FOLLOWED_BY_DIGEST = (Command.PREPARE, Command.SLICE)  # an ACTIVATE or a LEASE that is proven names the digest


class Reign(Enum):
    """Where the manager stands."""

    LISTENING = "listening"
    STANDBY = "standby"
    STARTING = "starting"
    REIGNING = "reigning"
    RETIRED = "retired"


class ManagerCore:
    """The manager of one spec, on one bus (port 0)."""

    def __init__(
        self,
        spec: Spec,
        node: int,
        memory: Memory,
        now_ns: int,
        window_ns: int = START_UP_WINDOW_NS,
        *,
        advise: bool = False,
        on_board: ContingencyNumbers | None = None,
        key: Key | None = None,
        standby: bool = False,
        tells_departures: bool = False,
    ) -> None:
        """Start listening at `now_ns` as manager `node` (126 or 127), with what is remembered of this spec.

        advise: say nothing on the bus, ever, and tell what would be done instead.
        on_board: what PEs that were given their part of the contingency file can be switched to by number.
        key: of the fleet; with one every command is tagged, and nothing is believed that was not.
        standby: stand by while another manager reigns, instead of ending.
        tells_departures: whoever drives this says when an ALIVE is on the bus; else it is taken to be there at once.
        Raises NoTermError where all terms have been used.
        """
        self._spec, self._node = spec, node
        self.alive_id = management_id(node, Command.ALIVE)
        self._bus = spec.buses[spec.manager.bus]
        period_ns = self._bus.heartbeat_ns
        self._longest_gap_ns = late_ns(period_ns)  # between two steps of a manager that reigns, as long as it runs
        self.lease_ns = t_lease_ns(period_ns)  # T_lease; what could not be sent for so long is not sent at all
        self._reign = Reign.LISTENING
        self._listen_until_ns: int | None = now_ns + self.lease_ns  # None: until somebody is heard, and longer
        self._goes_first = node == FIRST_MANAGER or not standby  # where nobody reigns
        self._advise, self._standby, self._window_ns = advise, standby, window_ns
        self._key, self._on_board, self._tells_departures = key, on_board, tells_departures
        self._journal_problem: str | None = None
        self._refused_ns: int | None = None  # since when most PEs say that they hear no LEASE
        self._refusals = 0  # reigns, one after the other, that have ended for it
        self._has_leapt = False  # more often, who is not heard for another reason would use up all terms
        term = next_term(node, memory.term)
        self._turn = Turn(node, now_ns, term=term, memory=memory, silent=advise)
        self._planning = Planning(self._turn)
        self._begin()
        self._beacon = Beacon(node, period_ns, now_ns + self.lease_ns)
        self._identification = IdentificationService(node)
        self._pe_of_state_id = {state_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._pe_of_emcy_id = {emcy_id(pe.node_id): pe.name for pe in spec.pes.values()}
        followed = tuple(Command) if standby or advise else (Command.LEASE,)
        if key is not None:
            followed = tuple({*followed, Command.CONTROL, Command.TAG})
        self._manager_ids = {
            management_id(one, command): (one, command) for one in MANAGER_NODES for command in followed
        }
        self._turn.emit(
            "manager_started",
            spec=spec.name,
            spec_digest=spec.digest,
            node=node,
            term=term,
            bus=self._bus.name,
            phase=self._situation.phase,
            advises=advise,
            key=None if key is None else key.fingerprint,
        )

    def _begin(self) -> None:
        """Begin with nothing but what is remembered."""
        spec, turn = self._spec, self._turn
        self._has_to_leave_out = False  # somebody who is counted on no more, and whom the last ALIVE named
        self._health = Health(spec, turn.now_ns, self._window_ns)
        self._exclusion = Exclusion(spec, tells_departures=self._tells_departures)
        self._situation = KnownSituation(
            spec, turn, self._health, self._take, self._replan, limited=self._limited, stopped=self._stopped
        )
        key = self._key
        self._orders = OperatorOrders(spec, turn, self._health, self._situation, has_key=key is not None)
        self._deployment = Deployment(
            turn, spec, self._health, self._exclusion, self._on_board, frames_per_command=1 if key is None else 2
        )
        self._authenticity: Authenticity | None = None
        if key is not None:
            self._authenticity = Authenticity(spec, turn, key, digest_of=self._digest_of, speaks=self._speaks)
        self._announcer = Announcer(spec, self._situation)
        self._following = Following(
            spec, turn, self._situation, self._exclusion, self._window_ns, on_board=self._on_board
        )

    @property
    def reigns(self) -> bool:
        """Tell whether it commands."""
        return self._reign in (Reign.STARTING, Reign.REIGNING)

    @property
    def term(self) -> int:
        """Number of its reign, the present or the last one."""
        return self._turn.term

    def hears(self, identifier: int) -> bool:
        """Tell whether frames of an identifier mean anything here; a driver may keep all others to itself."""
        return (
            identifier in self._pe_of_state_id
            or identifier in self._pe_of_emcy_id
            or identifier in self._manager_ids
            or identifier in self._situation.links.records
            or identifier == REQUEST_ID
        )

    def step(self, now_ns: int, event: ManagerEvent) -> list[ManagerAction]:
        """Take one event at `now_ns`; returns what is to be done, in order."""
        if self._reign is Reign.RETIRED:
            return []
        gap_ns = now_ns - self._turn.now_ns
        if gap_ns > self._longest_gap_ns:
            self._exclusion.slept(gap_ns)
        self._turn.now_ns = now_ns
        match event:
            case Received(frame=frame):
                self._receive(frame)
            case Tick():
                self._tick()
            case PlanReady():
                self._plan_ready(event)
            case PlanFailed():
                self._plan_failed(event)
            case OperatorSaid():
                self._turn.ask(self._obey(event))
            case JournalTold() | AliveLeft() | ChannelsLost():  # pragma: no branch - nothing else is left
                self._driver_told(event)
        if self._reign is Reign.STANDBY and self._following.is_orphaned():
            self._follow_up()
        if self.reigns:
            self._leave_out()
            self._advance()
        return self._turn.end()

    def next_deadline_ns(self) -> int | None:
        """When to call with Tick at the latest."""
        if self._reign is Reign.RETIRED:
            return None
        if self._reign is Reign.LISTENING:
            due_ns = self._identification.next_ns
            return self._listen_until_ns if due_ns == NEVER_NS else min(due_ns, self._listen_until_ns or due_ns)
        if self._reign is Reign.STANDBY:
            waits = (
                self._following.next_deadline_ns(),
                self._health.next_deadline_ns(),
                self._identification.next_ns,
            )
            return min((deadline for deadline in waits if deadline is not None), default=None)
        due_ns = min(self._beacon.next_ns, self._identification.next_ns)
        for epoch_ns in self._deployment.next_deadlines_ns():
            due_ns = min(due_ns, epoch_ns)
        for other_ns in (self._health.next_deadline_ns(), self._planning.again_ns):
            if other_ns is not None:
                due_ns = min(due_ns, other_ns)
        return due_ns

    def validate(self) -> None:
        """Check what must hold between two steps; raises InvariantError with the recent events."""
        self._deployment.validate()
        if not self._advise:
            self._validate_memory()

    def _validate_memory(self) -> None:
        """What a restart would find is what is known now."""
        memory, situation, recent = self._turn.memory, self._situation, self._turn.recent
        current, runs = self._deployment.current, self._turn.memory.runs
        require(memory.phase in (None, situation.phase), "the phase is not remembered: {}", recent)
        require(memory.latched.keys() == situation.failed.elements, "latched faults are not remembered: {}", recent)
        quarantined = {pe: self._health.losses(pe) for pe in self._spec.pes if self._health.is_quarantined(pe)}
        require(memory.quarantined == quarantined, "quarantines are not remembered: {}", recent)
        if current is not None:
            told = runs is not None and (runs.epoch, runs.digest) == (current.epoch, current.compiled.digest)
            require(told, "what runs is not remembered: {}", recent)

    # Frames

    def _receive(self, frame: Frame) -> None:
        if frame.extended or frame.remote or frame.error:
            return
        pe = self._pe_of_state_id.get(frame.can_id)
        if pe is not None:
            self._hear_state(pe, frame.data)
        elif frame.can_id in self._pe_of_emcy_id:
            self._hear_emergency(self._pe_of_emcy_id[frame.can_id], frame.data)
        elif frame.can_id in self._situation.links.records:
            self._situation.link_reported(frame)
        elif frame.can_id == REQUEST_ID:
            self._identification.asked(0, frame, self._turn.now_ns)
        elif frame.can_id in self._manager_ids:
            self._on_manager(*self._manager_ids[frame.can_id], frame)

    def _hear_state(self, pe: str, data: bytes) -> None:
        """A PE speaks of itself; with a key that counts as far as it is believed."""
        page = decode_state(data)
        if self._authenticity is None or isinstance(page, Malformed):
            self._on_state(pe, page)
            return
        believed = self._authenticity.believed(pe, page, data)
        self._on_state(pe, believed)
        if believed is None and isinstance(page, StatePage0):
            self._health.spoke(pe, page.incarnation, self._turn.now_ns)
            self._following.state(pe, page, is_proven=False)

    def _hear_emergency(self, pe: str, data: bytes) -> None:
        """A PE reports something; with a key it counts when it is proven, unless nothing follows from it."""
        emergency = decode_emergency(data)
        if isinstance(emergency, Emergency) and emergency.kind is ElementKind.CHANNEL:
            if self.reigns:
                self._situation.channels.reported(pe, emergency)
        elif self._authenticity is None:
            self._on_emergency(pe, emergency)
        else:
            self._authenticity.hold_emergency(pe, data)

    def _on_manager(self, node: int, command: Command, frame: Frame) -> None:
        """Another manager has spoken; with a key what it says counts when it is proven."""
        if self._authenticity is None or command in _FOLLOWED_BY_DIGEST:
            self._on_command(node, decode_command(command, frame.data))
        elif command is Command.TAG:
            found = self._authenticity.proven(node, frame.data)
            if found is not None:
                self._on_command(node, decode_command(found.command, found.event.frame.data))
        else:
            if command is Command.CONTROL and (self._advise or self._reign is Reign.STANDBY):
                self._authenticity.overhear(node, frame.data)
            self._authenticity.hold(node, command, Received(0, frame))

    def _digest_of(self, epoch: int) -> int | None:
        """Digest of an epoch of this reign, or of the one that was followed; None of one that is not known."""
        known = self._deployment.digest_of(epoch)
        return self._following.digest_of(epoch) if known is None else known

    def _speaks(self) -> bool:
        """Tell whether LEASE goes out."""
        return self.reigns and not self._advise

    def _on_state(self, pe: str, page: StatePage | Malformed | None) -> None:
        now_ns = self._turn.now_ns
        if self._reign is Reign.LISTENING and self._listen_until_ns is None and not isinstance(page, Malformed):
            self._begin()
            if self._key is None:  # with one nobody can be believed before this reigns, and commands
                self._health.in_flight(now_ns)  # who was down before it fell silent need not be waited for
            self._listen_until_ns = now_ns + self.lease_ns
        match page:
            case StatePage0():
                self._heard(pe, page.incarnation, page.flags)
                if page.state is not PeState.UNCONFIGURED:
                    self._health.in_flight(now_ns)
                self._following.state(pe, page)
                cause = self._deployment.observe(pe, page)
                if self._advise:
                    self._follow()
                else:
                    self._fail_if(pe, cause)
                    self._outnumber(pe)
                proven = None if self._authenticity is None else self._authenticity.take_emergency(pe)
                if proven is not None:
                    self._on_emergency(pe, decode_emergency(proven))
            case StatePage1():
                if self._authenticity is None:
                    self._heard(pe, None, page.flags)
                if not self._advise:
                    self._fail_if(pe, self._deployment.staging(pe, page))
            case StatePage2() if self._authenticity is not None and self._speaks():
                self._authenticity.answer(pe, page)
            case StatePage2() | StatePage3() | Malformed() | None:  # pragma: no branch - nothing else is left
                pass

    def _heard(self, pe: str, incarnation: int | None, flags: PeFlags) -> None:
        """A PE lives."""
        self._exclusion.heard(pe)
        hears = PeFlags.HEARS_LEASE in flags or not self._speaks()
        self._take(self._health.heard(pe, incarnation, self._turn.now_ns, hears_lease=hears))

    def _on_emergency(self, pe: str, emergency: Emergency | Malformed) -> None:
        if isinstance(emergency, Malformed) or emergency.code is FaultCode.RESET:
            return
        if not self.reigns:  # it will be said again until somebody acknowledges it
            return
        is_request = emergency.kind is ElementKind.PHASE
        if is_request and self._advise and self._following.hears_lease():
            return  # whoever reigns tells what comes of it
        heard = self._situation.requested(pe, emergency) if is_request else self._situation.reported(pe, emergency)
        if heard:
            if is_request:  # who acknowledges what nobody else knows, and dies, has silenced it for good
                self._tell_held(self._announcer.phase())
            node = self._spec.pes[pe].node_id
            told = Control(self._turn.term, node, Operation.ACKNOWLEDGE, *emergency.acknowledgement)
            self._turn.send(Command.CONTROL, told)

    def _on_command(self, node: int, message: ManagementMessage | Malformed) -> None:
        """Another manager speaks."""
        if isinstance(message, Malformed):
            return
        if self._reign is Reign.STANDBY:
            before = self._following.node
            self._following.heard(node, message)
            if before is None and self._following.node is not None:
                self._turn.emit("standing_by", node=node, term=self._following.term)
        elif self._advise:
            if self._reign is Reign.LISTENING and self._following.node is None and isinstance(message, Lease):
                self._listen_until_ns = self._turn.now_ns + LEARNS_LEASES * self.lease_ns
            self._following.heard(node, message)
        elif isinstance(message, Lease):
            self._on_lease(node, message)

    def _on_lease(self, node: int, lease: Lease) -> None:
        is_double = node == self._node and lease.term == self._turn.term  # it is not this one's: those do not come in
        if self._reign is Reign.LISTENING and self._standby:
            self._stand_by(node, lease)
        elif self._reign is Reign.LISTENING:
            self._retire(node, lease, f"manager {node} already reigns on {self._bus.name} (term {lease.term})")
        elif (lease.term > self._turn.term or is_double) and self._standby:
            self._turn.emit("stepped_down", node=node, term=lease.term)
            self._planning.forget()
            self._begin()
            self._stand_by(node, lease)
        elif is_double:
            self._retire(node, lease, f"another manager {node} reigns on {self._bus.name}, in the same term")
        elif lease.term > self._turn.term:
            self._retire(node, lease, f"manager {node} reigns with the higher term {lease.term}")

    def _retire(self, node: int, lease: Lease, reason: str) -> None:
        self._turn.emit("second_manager", node=node, term=lease.term)
        self._end(reason, "; stop it first, or let this one be")

    def _end(self, reason: str, remedy: str = "") -> None:
        self._reign = Reign.RETIRED
        self._turn.emit("stopped", reason=reason)
        self._turn.ask(Stop(reason + remedy))

    def _stand_by(self, node: int, lease: Lease) -> None:
        self._reign = Reign.STANDBY
        self._on_command(node, lease)

    def _follow_up(self) -> None:
        """Nobody reigns any more: take over from whom this one has followed."""
        followed, now_ns = self._following, self._turn.now_ns
        vouched_for = self._health.vouched_for(filter(self._deployment.is_active, followed.counted_on()), now_ns)
        self._take(vouched_for)
        self._begin_term()
        for change in vouched_for:
            self._exclusion.unknown(change.pe)  # nothing that it has taken up was counted here
        if not self.reigns:
            return
        silent_ns = None if followed.leased_ns is None else now_ns - followed.leased_ns
        self._turn.emit(
            "taken_over",
            term=self._turn.term,
            before=followed.term,
            silent_ns=silent_ns,
            phase=self._situation.phase,
        )
        known_ns = followed.leased_ns if followed.leased_ns is not None else now_ns
        self._planning.causes.append(Cause("nobody reigned", now_ns, known_ns))
        self._health.await_again(followed.unbelieved(), now_ns, self._window_ns)
        if not self._health.starting():
            self._ask_for_plan()

    # Time

    def _tick(self) -> None:
        now_ns = self._turn.now_ns
        self._turn.ask(*self._identification.tick(now_ns))
        if self._reign is Reign.LISTENING and self._listen_until_ns is not None and now_ns >= self._listen_until_ns:
            if self._goes_first:
                self._begin_term()
            else:
                self._reign = Reign.STANDBY
        if self._reign in (Reign.LISTENING, Reign.RETIRED):
            return
        self._take(self._health.tick(now_ns))
        hears_nobody = self._health.hears_nobody(now_ns)
        if hears_nobody:
            self._blame_nobody()
        if self._reign is Reign.REIGNING and not self._advise and self._is_over(hears_nobody=hears_nobody):
            self._fall_silent()
            return
        if self._reign is Reign.STANDBY:
            return
        for pe in self._deployment.tick():
            self._fail_if(pe, "it does not acknowledge")
        if now_ns >= self._beacon.next_ns:
            self._beat()
        first = self._reign is Reign.STARTING and not self._health.starting()
        if first or self._planning.is_due_again():
            self._ask_for_plan()

    def _blame_nobody(self) -> None:
        """It is this manager that hears nobody: whom that put in quarantine has done nothing."""
        for pe in self._health.take_back():
            if self._health.is_quarantined(pe):
                self._turn.keep(Quarantined(pe, self._health.losses(pe)))
            elif pe in self._turn.memory.quarantined:
                self._turn.keep(Released(pe))

    def _is_over(self, *, hears_nobody: bool) -> bool:
        """Tell whether this reign has come to its end: this manager is cut off, or deaf, or its term is behind."""
        if hears_nobody:
            self._turn.emit("hears_nobody", term=self._turn.term)
            return True
        if self._turn.now_ns >= self._beacon.next_ns and self._is_refused():
            self._turn.emit("refused", term=self._turn.term)
            return True
        return False

    def _is_refused(self) -> bool:
        """Tell whether most PEs say, and have said for long, that they hear no LEASE, though this manager speaks."""
        now_ns = self._turn.now_ns
        if not self._following.most_hear_none():
            self._refused_ns, self._refusals = None, 0
            return False
        self._refused_ns = now_ns if self._refused_ns is None else self._refused_ns
        if now_ns - self._refused_ns < self.lease_ns << min(self._refusals, _MOST_DOUBLINGS):
            return False
        self._refused_ns, self._refusals = None, self._refusals + 1
        return True

    def _fall_silent(self) -> None:
        """Forget all but what is remembered, say nothing, and begin anew with whoever is heard next."""
        self._planning.forget()
        self._begin()
        self._reign, self._listen_until_ns, self._goes_first = Reign.LISTENING, None, True

    def _begin_term(self) -> None:
        """Begin to speak: from now on the PEs know this term. Who is not heard may drive on for T_lease."""
        self._reign, now_ns = Reign.STARTING, self._turn.now_ns
        self._refused_ns = None  # of this reign nobody has heard anything yet
        leap = _LEAP if self._refusals >= _LEAPS_AFTER and not self._has_leapt else 0
        self._has_leapt = self._has_leapt or leap > 0
        try:
            term = self._turn.term = next_term(self._node, self._turn.memory.term + leap)
        except NoTermError as error:
            self._end(str(error))
            return
        self._turn.keep(TermBegun(term))
        self._deployment.begin(term)
        self._exclusion.begun(now_ns, self._health.counted_on())
        self._beacon = Beacon(self._node, self._bus.heartbeat_ns, now_ns)

    def _beat(self) -> None:
        """LEASE, ALIVE, and PING for whoever is suspect."""
        now_ns = self._turn.now_ns
        self._situation.channels.beat()
        suspects = [pe for pe in self._health.counted_on() if self._health.standing(pe) is Standing.SUSPECT]
        lease = self._deployment.lease()
        self._turn.ask(*self._beacon.beat(now_ns, lease, self._named(), self._nodes(suspects)))
        fact = self._announcer.next()
        self._tell_held(fact)
        if fact is not None and fact[0] is ElementKind.PHASE:
            self._tell_obeyed()

    def _leave_out(self) -> None:
        """Say at once that somebody is counted on no more: until it may hear that, it drives what it was given."""
        if self._has_to_leave_out:
            self._turn.ask(self._beacon.alive(self._turn.term, self._named()))

    def _has_said(self, frame: Frame) -> None:
        """An ALIVE of this manager is on the bus: whoever it leaves out is counted on no more from now on."""
        if not self._exclusion.waits:
            return
        alive = decode_command(Command.ALIVE, frame.data)
        if isinstance(alive, Alive) and alive.term == self._turn.term:
            pes = {pe.name for pe in self._spec.pes.values() if pe.node_id in alive.nodes}
            self._exclusion.said(pes, self._turn.now_ns)

    def _named(self) -> frozenset[int]:
        """Nodes that an ALIVE names which goes out now."""
        named = [*self._health.counted_on(), *self._health.awaited_again()]
        self._exclusion.named(named, self._turn.now_ns)
        self._has_to_leave_out = False
        return self._nodes(named)

    def _tell_held(self, fact: Fact | None) -> None:
        if fact is not None:
            self._turn.send(Command.CONTROL, Control(self._turn.term, _EVERYBODY, Operation.HOLDS, *fact))

    def _tell_obeyed(self) -> None:
        """Say once more which requests for a phase have been obeyed: a standby may have missed that, or been away."""
        for pe, asked in self._turn.memory.asked.items():
            if self._health.said_incarnation(pe, self._turn.now_ns) == asked.incarnation:
                obeyed = Operation.ACKNOWLEDGE, ElementKind.PHASE, asked.number
                self._turn.send(Command.CONTROL, Control(self._turn.term, self._spec.pes[pe].node_id, *obeyed))

    def _nodes(self, pes: Iterable[str]) -> frozenset[int]:
        return frozenset(self._spec.pes[pe].node_id for pe in pes)

    def _advance(self) -> None:
        """Move the epochs on; one that is done has taken its causes into account."""
        done = self._deployment.advance()
        if done is not None:
            self._planning.done(done.causes)
            self._settle()

    # Health

    def _take(self, changes: list[HealthChange]) -> None:
        for change in changes:
            self._take_one(change)

    def _take_one(self, change: HealthChange) -> None:
        pe, last, now_ns = change.pe, change.last_heard_ns, self._turn.now_ns
        match change.change:
            case Change.SUSPECTED:
                silent = now_ns - last if last is not None else None
                self._turn.emit("pe_suspected", pe=pe, cause=change.cause, silent_ns=silent)
                if self.reigns:
                    self._turn.ask(self._beacon.ping(self._turn.term, self._spec.pes[pe].node_id))
            case Change.ANSWERED:
                self._turn.emit("pe_answered", pe=pe)
            case Change.LOST | Change.REBOOTED | Change.FAILED:
                if change.change is Change.REBOOTED:
                    self._exclusion.rebooted(pe)
                elif change.change is Change.LOST:
                    self._exclusion.declared_down(pe, now_ns if last is None else last)
                self._turn.emit("pe_lost", pe=pe, cause=change.cause, last_heard_ns=last)
                if self._health.is_quarantined(pe):
                    self._turn.keep(Quarantined(pe, self._health.losses(pe)))
                self._deployment.lost(pe)
                self._has_to_leave_out = self._speaks()
                self._situation.links.restarted(pe)
                self._replan(f"pe:{pe}: {change.cause}", since_ns=last)
            case Change.ABSENT:
                self._turn.emit("pe_absent", pe=pe, cause=change.cause)
                self._replan(f"pe:{pe}: {change.cause}")
            case Change.HEARD_AGAIN:
                self._turn.emit("pe_heard_again", pe=pe, cause=change.cause)
            case Change.JOINED:  # pragma: no branch - nothing else is left
                if pe in self._turn.memory.quarantined:
                    self._turn.keep(Released(pe))
                self._turn.emit("pe_joined", pe=pe, cause=change.cause)
                self._deployment.joined(pe)
                self._replan(f"pe:{pe} joined")

    def _fail_if(self, pe: str, cause: str | None) -> None:
        """Stop counting on a PE that speaks, if there is a cause to."""
        if cause is not None:
            self._take(self._health.fail(pe, cause, self._turn.now_ns))

    def _outnumber(self, pe: str) -> None:
        """Whoever hears a newer epoch than its own drives nothing exclusive (rule 6): there has to be one above it."""
        if self._reign is Reign.REIGNING and not self._planning.is_owed and self._deployment.is_overtaken_by(pe):
            self._replan(f"pe:{pe}: it runs a newer epoch")

    # The operator

    def _obey(self, said: OperatorSaid) -> Reply:
        """Do what the operator says, if it can be done; orders are obeyed from the start of the reign on."""
        if isinstance(said.order, AskStatus):
            return Reply(said.number, done=True, sentence="", status=self.status())
        if self._reign is Reign.STANDBY:
            where = f"say it to manager {self._following.node}"
            return Reply(said.number, done=False, sentence=f"this manager only stands by: {where}")
        if self._reign is Reign.LISTENING:
            return Reply(said.number, done=False, sentence="the manager has just started and still listens: try again")
        reply = self._orders.obey(said.number, said.order)
        self._announcer.look()  # what this has ended may begin again before the next beat
        return reply

    def status(self) -> dict[str, Any]:
        """Everything the manager knows, as plain data (`status`)."""
        manager = {
            "node": self._node,
            "term": self._turn.term,
            "state": self._reign.value,
            "advises": self._advise,
            "planning": self._planning.waiting,
            "journal": self._journal_problem,
            "key": None if self._key is None else self._key.fingerprint,
        }
        return status(
            self._spec,
            self._turn.now_ns,
            manager=manager,
            health=self._health,
            situation=self._situation,
            deployment=self._deployment,
            unknown_epoch=None if self._reign is Reign.STANDBY else self._unknown_epoch(),
            authenticity=self._authenticity,
        )

    # What its driver says

    def _driver_told(self, event: JournalTold | AliveLeft | ChannelsLost) -> None:
        match event:
            case JournalTold(problem):
                self._journal_told(problem)
            case AliveLeft(frame):
                self._has_said(frame)
            case ChannelsLost(channels):  # pragma: no branch - nothing else is left
                self._situation.channels.own(channels)

    def _journal_told(self, problem: str | None) -> None:
        before, self._journal_problem = self._journal_problem, problem
        if problem is None:
            self._turn.emit("journal_kept", before=before)
        else:
            self._turn.emit("journal_failed", problem=problem)

    # Plans

    def _replan(self, cause: str, *, since_ns: int | None = None) -> None:
        """The situation has changed: what is being prepared is void, and a new plan is needed.

        since_ns: the last sign of the old situation, where it is older than this moment.
        """
        if self._reign is Reign.STANDBY:
            return
        now_ns = self._turn.now_ns
        self._planning.causes.append(Cause(cause, now_ns, since_ns if since_ns is not None else now_ns))
        self._deployment.abandon(cause)
        if self._reign is not Reign.LISTENING and not self._health.starting():
            self._ask_for_plan()

    def _stopped(self, module: str) -> None:
        """A module is well again that its PE has stopped."""
        if self.reigns:
            self._deployment.stopped(module)

    def _limited(self, cause: str) -> None:
        """A radio has another limit: if what runs is as good as any under it, nothing is to be done."""
        plan = self._deployment.plan
        if plan is not None and self._planning.idle and self._situation.spares(plan):
            self._settle()
        else:
            self._replan(cause)

    def _ask_for_plan(self) -> None:
        first, self._reign = self._reign is Reign.STARTING, Reign.REIGNING
        runs = self._following.runs if self._advise else self._turn.memory.runs
        if first and self._deployment.adopts_remembered(self._situation.now(), runs):
            self._weigh()
        else:
            self._planning.ask(self._situation.now(), self._deployment.running)

    def _follow(self) -> None:
        """When advising: see what another manager has brought about, and what is to be said of it."""
        if self._reign is Reign.REIGNING and self._deployment.follow(self._situation.now(), self._following.runs):
            self._planning.causes.append(Cause("another epoch runs", self._turn.now_ns, self._turn.now_ns))
            self._weigh()

    def _unknown_epoch(self) -> int | None:
        """Epoch that runs, where this manager does not know what that is."""
        return self._deployment.unknown_epoch(self._following.leased_epoch())

    def _weigh(self) -> None:
        """It has become known what runs: where that may stay, a better plan is asked for at leisure."""
        if self._may_stay() and not self._planning.waiting:
            self._planning.causes.clear()
            self._settle()
        else:
            self._planning.ask(self._situation.now(), self._deployment.running)

    def _may_stay(self) -> bool:
        """Tell whether what runs can go on as it is: legal, with all that is critical, and nobody waits outside."""
        plan, phase = self._deployment.plan, self._situation.phase
        if plan is None or not self._deployment.everybody_runs_it():
            return False
        functions = self._spec.functions.values()
        wanted = sum(f.priority_in(phase) for f in functions if f.criticality_in(phase) in CRITICAL_CLASSES)
        if sum(plan.objective.critical) < wanted:
            return False
        return not verify(self._spec, self._situation.now(), plan.configuration)

    def _settle(self) -> None:
        """Say that nothing is under way, if nothing is."""
        running, plan = self._deployment.running, self._deployment.plan
        if running is None or self._deployment.next is not None or self._planning.waiting:
            return
        if plan is not None and not plan.optimal and not self._planning.at_leisure:
            self._planning.ask_at_leisure(self._situation.now(), running)
        else:
            self._turn.ask(Settled(self._situation.now(), running))

    def _plan_ready(self, answer: PlanReady) -> None:
        if not self._planning.awaits(answer):
            return
        if self._planning.keeps_to(self._deployment.plan, answer):
            self._settle()
            return
        self._planning.takes(answer)
        if self._advise:
            self._following.planned(answer.plan)
        if self._runs_already(answer.plan):
            self._planning.causes.clear()
            self._turn.emit("plan_unchanged", request=answer.request)
            self._settle()
        elif self._advise:
            self._deployment.advise(answer.plan, self._unknown_epoch(), self._following.runs)
            self._planning.causes.clear()
        else:
            self._deployment.prepare(answer.plan, self._planning.causes)

    def _plan_failed(self, answer: PlanFailed) -> None:
        if self._planning.failed(answer) and self._planning.at_leisure:
            self._planning.causes.clear()
            self._settle()

    def _runs_already(self, plan: Plan) -> bool:
        """Tell whether nothing has to be done for a plan; what another reign has brought about may be just that."""
        first = self._deployment.current is None or self._advise
        return self._deployment.runs(plan) or (first and self._deployment.adopts(plan))
