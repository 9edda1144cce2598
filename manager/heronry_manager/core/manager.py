"""The manager's core: frames, time, plans and orders in; frames, requests for plans, events and records out.

This file decides nothing itself: it only calls the parts that act, in the right order. It uses no clock, socket,
solver or file.

    frame in ─► inbound ─► pe_reports ─► reactions ─► replanning ─► deployment ─► frames out
                   └────► succession (another manager) ─► mastership (whether this one is active)

    knowledge      what is known: health, situation, what runs, what another manager sends. All of this is
                   forgotten when the manager falls silent or stands by
    mastership     listening, standing by, starting, active or retired; carried out by `succession`
    inbound        every frame, decoded and authenticated
    pe_reports     what PEs report of themselves
    reactions      what follows from a change of health or of the situation
    replanning     from another situation to a plan, from a plan to what runs
    beat           what an active manager sends in each period

From a fault to a running configuration:

1. *Health* says which PEs are available. The available PEs and the latched faults are the *situation*. A
   requested mission phase, and an element that the operator fails or clears, change the situation like a fault.
2. When the situation changes, the core requests a plan with `RequestPlan`. The answer is `PlanReady` or
   `PlanFailed`, with the number of the request, so that an answer to an older request is dropped.
3. The plan becomes an epoch (`epochs`), and the epoch becomes the running configuration.

After each event the core does the following, in this order:

1. If this manager stands by, and no manager is active any more, it takes over.
2. If this manager is active, and a PE was just lost, an ALIVE without this PE goes out.
3. If this manager is active, it commands the next step of each epoch for which nothing is left to wait for.

When a manager was paused, frames and deadlines wait for it: the driver gives it the frames first.

After a restart the manager begins a new term, and starts as usual. It begins with all that it remembers: the
phase, latched faults, quarantines, what runs (`memory`, which the driver keeps in the journal). The PEs go on
with what they run (`replanning`).
"""

from collections.abc import Iterable, Mapping
from typing import Any

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, module_of
from heronry_manager import events
from heronry_manager.core.epochs import next_term
from heronry_manager.core.heartbeat import Beat
from heronry_manager.core.intake import Inbound, OperatorOrders, PeReports, Reactions, Succession, module_problem
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.memory import Memory
from heronry_manager.core.planning import PlanRequests, Replanning
from heronry_manager.core.reloading import Reloading
from heronry_manager.core.reports import Look, status
from heronry_manager.core.settings import CodeBundle, ManagerSettings
from heronry_manager.core.tables import Compiler, ContingencyNumbers
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import (
    AliveLeft,
    AskStatus,
    AskTraceback,
    ChannelsLost,
    DriverEvent,
    FailElement,
    JournalTold,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    OrderToExecute,
    PlanFailed,
    PlanReady,
    ReloadSpec,
    Reply,
    SpecAtHand,
    SwitchReady,
)
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import ManagementMessage
from heronry_wire.protocol_times import START_UP_WINDOW_NS, late_ns
from heronry_wire.sansio import NEVER_NS, Received, Tick
from heronry_wire.standstill import StoodStill


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
        reads_objects: bool = False,
        tables: Mapping[str, bytes] | None = None,
        bundles: tuple[CodeBundle, ...] = (),
        compiler: Compiler | None = None,
    ) -> None:
        """Begin to listen at `now_ns`; `memory`: what the journal has kept for this spec.

        compiler: that of this spec, where several cores of a process share it; None: the core makes its own.
        `ManagerSettings` explains the other arguments.

        Raises NoTermError if all terms have been used.
        """
        settings = ManagerSettings(
            spec,
            compiler or Compiler(spec),
            node,
            window_ns=window_ns,
            advise=advise,
            on_board=on_board,
            key=key,
            standby=standby,
            tells_departures=tells_departures,
            reads_objects=reads_objects,
            tables=tables,
            bundles=bundles,
        )
        self._settings = settings
        self.alive_id = management_id(node, Command.ALIVE)
        self.heartbeat_ns = settings.bus.heartbeat_ns  # of the manager's bus
        self.lease_ns = settings.lease_ns  # T_lease; the driver drops a frame that could not be sent for so long
        self._longest_gap_ns = late_ns(settings.bus.heartbeat_ns)  # between two steps while active, without a pause
        turn = self._turn = Turn(node, now_ns, term=next_term(node, memory.term), memory=memory, silent=advise)
        claim = self._claim = Claim(settings, turn)
        known = self._known = Knowledge(settings, turn, claim)
        self._health, self._exclusion, self._situation = known.health, known.exclusion, known.situation
        self._deployment, self._following, self._details = known.deployment, known.following, known.details
        self._bringing, self._code = known.bringing, known.code
        requests = PlanRequests(turn)
        beat = self._beat = Beat(settings, turn, known)
        replanning = self._replanning = Replanning(settings, turn, claim, known, requests)
        reactions = self._reactions = Reactions(turn, claim, known, beat, replanning)
        reports = PeReports(settings, turn, claim, known, beat=beat, replanning=replanning, reactions=reactions)
        succession = self._succession = Succession(
            settings, turn, claim, known, beat=beat, replanning=replanning, reactions=reactions
        )
        self._reloading = Reloading(settings, turn, claim, known)
        self._inbound = Inbound(
            settings,
            turn,
            claim,
            known,
            reports=reports,
            reactions=reactions,
            succession=succession,
            reloading=self._reloading,
        )
        self._orders = OperatorOrders(settings, turn, known, requests)
        self._code.clear = reactions.code_arrived
        self._journal_problem: str | None = None
        turn.emit(
            events.ManagerStarted,
            spec=spec.name,
            spec_digest=spec.digest,
            node=node,
            term=turn.term,
            bus=settings.bus.name,
            phase=known.situation.phase,
            advises=advise,
            key=None if key is None else key.fingerprint,
        )

    @property
    def is_active(self) -> bool:
        """Tell whether this manager is active.

        A manager that only advises sends nothing. It counts as active while it would command if it were allowed to.
        """
        return self._claim.is_active

    @property
    def is_pressed(self) -> bool:
        """Tell whether something is urgent: a PE is suspected, a plan is awaited, or an epoch is on its way.

        A plan that was requested in the background is not awaited.
        """
        known = self._known
        return self._replanning.is_urgent or known.deployment.is_under_way() or known.health.suspects_any()

    @property
    def changes_spec(self) -> bool:
        """Tell whether a change to another spec is under way."""
        return self._reloading.is_under_way

    @property
    def term(self) -> int:
        """The number of this manager's present or last mastership."""
        return self._turn.term

    @property
    def plan(self) -> Plan | None:
        """The plan of the current epoch: the last one that was activated or adopted; None: there is none."""
        return self._deployment.plan

    @property
    def memory(self) -> Memory:
        """What the journal keeps of this manager."""
        return self._turn.memory

    def succeed(self, states: Iterable[Frame]) -> None:
        """Begin at once, without listening, as the core of the next spec in the process of the manager that was active.

        states: the last page 0 of each PE, as it came. To be called before the first `step`. With a key the PEs must
        first believe this core, as after a restart, so what they have said proves nothing yet.
        """
        if self._settings.key is None:
            for frame in states:
                self._inbound.take(frame)
        self._claim.succeeds()

    def catch_up(self, preparation: Iterable[ManagementMessage]) -> None:
        """Begin as the core of the spec that flies in the process of a standby manager (`SpecFollowed`)."""
        self._following.catch_up(preparation)

    @property
    def now(self) -> Situation:
        """The situation as this manager knows it."""
        return self._situation.now()

    def hears(self, identifier: int) -> bool:
        """Tell whether the manager uses frames with this identifier; a driver may drop all others."""
        return self._inbound.hears(identifier)

    def step(self, now_ns: int, event: ManagerEvent) -> list[ManagerAction]:
        """Process one event at `now_ns`; gives the actions for the driver, in order."""
        if self._claim.state is Mastership.RETIRED:
            return []
        gap_ns = now_ns - self._turn.now_ns
        if gap_ns > self._longest_gap_ns:
            self._exclusion.slept(gap_ns)
        self._turn.begin(now_ns)
        match event:
            case Received(frame=frame):
                self._inbound.take(frame)
            case Tick():
                self._tick()
            case PlanReady():
                self._replanning.ready(event)
            case PlanFailed():
                self._replanning.failed(event)
            case SwitchReady():
                self._reloading.ready(event)
            case OperatorSaid():
                self._turn.do(*self._accept(event))
            case (
                JournalTold() | AliveLeft() | ChannelsLost() | SpecAtHand() | StoodStill()
            ):  # pragma: no branch - nothing else is left
                self._driver_told(event)
        if self._claim.state is Mastership.STANDBY and self._following.is_orphaned():
            self._succession.take_over()
        if self._claim.is_active:
            self._beat.leave_out()
            self._replanning.advance()
        self._details.end_of_step()
        self._bringing.end_of_step()
        self._code.end_of_step()
        self._known.unknown_nodes.end_of_step()
        self._reloading.end_of_step()
        return self._turn.end()

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) by which the driver must call `step` with Tick; None: no call is needed."""
        state, due_ns = self._claim.state, self._inbound.next_ns
        if state is Mastership.RETIRED:
            return None
        if state is Mastership.LISTENING:
            until_ns = self._claim.listens_until_ns
            return until_ns if due_ns == NEVER_NS else min(due_ns, until_ns or due_ns)
        if state is Mastership.STANDBY:
            other_ns = self._following.next_deadline_ns()
        else:
            due_ns = min(due_ns, self._beat.next_ns, self._deployment.next_deadline_ns())
            due_ns = min(due_ns, self._details.next_ns, self._bringing.next_ns, self._code.next_ns)
            due_ns = min(due_ns, self._known.unknown_nodes.next_ns)
            due_ns = min(due_ns, self._reloading.next_ns)
            other_ns = self._replanning.again_ns
        if other_ns is not None:
            due_ns = min(due_ns, other_ns)
        health_ns = self._health.next_deadline_ns()
        return due_ns if health_ns is None else min(due_ns, health_ns)

    def validate(self) -> None:
        """Check the invariants of the whole core; raises InvariantError, which lists the recent events."""
        self._claim.validate()
        self._known.validate()

    def _tick(self) -> None:
        claim, now_ns = self._claim, self._turn.now_ns
        self._inbound.tick()
        if claim.may_begin():
            self._succession.begin_term()
        if claim.state in (Mastership.LISTENING, Mastership.RETIRED):
            return
        self._reactions.take(self._health.tick(now_ns))
        hears_no_pe = self._health.hears_no_pe(now_ns)
        if hears_no_pe:
            self._reactions.discount_losses()
        if self._succession.is_over(hears_no_pe=hears_no_pe):
            self._succession.fall_silent()
        elif claim.is_active:
            for pe in self._deployment.tick():
                self._reactions.fail(pe, "it does not acknowledge")
            if self._beat.is_due():
                self._beat.beat()
            self._replanning.tick()
            self._details.tick()
            self._bringing.tick()
            self._code.tick()
            self._known.unknown_nodes.tick()
            self._reloading.tick()

    def _accept(self, said: OperatorSaid) -> tuple[Reply, ...]:
        """Answer a question or execute an order of the operator; a manager that listens or stands by refuses orders."""
        if isinstance(said.order, AskStatus):
            return (Reply(said.number, done=True, sentence="", status=self._status_for_operator()),)
        if isinstance(said.order, AskTraceback):
            self._ask_traceback(said.number, said.order.element)
            return ()
        return (self._execute(said.number, said.order),)

    def _execute(self, number: int, order: OrderToExecute | ReloadSpec) -> Reply:
        if self._claim.state is Mastership.STANDBY:
            where = f"give the order to manager {self._following.node}"
            return Reply(number, done=False, sentence=f"this is a standby manager: {where}")
        if self._claim.state is Mastership.LISTENING:
            return Reply(
                number, done=False, sentence="the manager has just started and still listens to the bus: try again"
            )
        if self._deployment.is_held() and not isinstance(order, FailElement):
            why = self._deployment.why_held()
            remedy = "'heronry status' says what to do, and 'heronry fail pe:NAME' gives up a PE"
            return Reply(number, done=False, sentence=f"{why}, so nothing is commanded: {remedy}")
        if isinstance(order, ReloadSpec):
            problem = self._reloading.order(order)
            follows = "'heronry status' shows how far it is"
            sentence = f"the tables of {order.name} are on their way; {follows}" if problem is None else problem
            return Reply(number, done=problem is None, sentence=sentence)
        if self._deployment.is_switching():
            return Reply(number, done=False, sentence="the PEs change to another spec: give the order again")
        outcome = self._orders.accept(order)
        self._reactions.take(outcome.changes)
        for command in outcome.commands:
            self._turn.send(Command.CONTROL, command)
        self._beat.look()
        return Reply(number, outcome.done, outcome.sentence, is_unusable=outcome.is_unusable)

    def _status_for_operator(self) -> dict[str, Any]:
        """Return the status; also read from the PEs how often they stood still and what they cost, for the next one."""
        for pe in self._settings.spec.pes.values():
            if self._health.is_available(pe.name) and not self._known.served.serves(pe.node_id):
                self._details.look_at_standstills(pe.name, Look.SHOW)
                self._details.look_at_cost(pe.name)
        return self.status()

    def _ask_traceback(self, number: int, element: str) -> None:
        """Read the traceback of a module that has failed, from the PE that has the traceback.

        The operator's order `number` is answered when the traceback has come or cannot come.
        """
        problem = module_problem(self._settings.spec, element)
        if problem is not None:
            self._turn.do(Reply(number, done=False, sentence=problem, is_unusable=True))
            return

        def answer(text: str | None, why_not: str) -> None:
            self._turn.do(Reply(number, done=text is not None, sentence=why_not if text is None else text))

        self._details.traceback(module_of(element), answer)

    def _driver_told(self, event: DriverEvent) -> None:
        match event:
            case JournalTold(problem):
                self._journal_told(problem)
            case AliveLeft(frame):
                self._beat.alive_left(frame)
            case ChannelsLost(channels):
                self._situation.own_channels_lost(channels)
            case SpecAtHand(digest):
                self._reloading.at_hand(digest)
            case StoodStill():  # pragma: no branch - nothing else is left
                self._details.stood_still(event)

    def _journal_told(self, problem: str | None) -> None:
        before, self._journal_problem = self._journal_problem, problem
        if problem is None:
            self._turn.emit(events.JournalKept, before=before)
        else:
            self._turn.emit(events.JournalFailed, problem=problem)

    def status(self) -> dict[str, Any]:
        """Return what the manager knows as plain data, in the form that the module `manager_status` describes."""
        key, known, numbers = self._settings.key, self._known, self._settings.on_board
        manager = {
            "node": self._settings.node,
            "term": self._turn.term,
            "state": self._claim.state.value,
            "advises": self._settings.advise,
            "planning": self._replanning.is_waiting,
            "journal": self._journal_problem,
            "key": None if key is None else key.fingerprint,
            "standstills": self._details.own_standstills(),
            "heartbeat_ns": self.heartbeat_ns,
            "contingencies": None if numbers is None else numbers.status(),
        }
        return status(
            self._settings.spec,
            self._turn.now_ns,
            manager=manager,
            health=self._health,
            situation=self._situation,
            deployment=self._deployment,
            script=known.script.status(),
            unknown_epoch=None if self._claim.state is Mastership.STANDBY else known.unknown_epoch(),
            authenticity=known.authenticity,
            details=self._details,
            held=known.held_outputs,
            silences=known.silences,
            code=known.code.status(),
            tables=known.bringing.status(),
            transfers=[one for one in (known.bringing.progress(), known.code.progress()) if one is not None],
            unknown_nodes=known.unknown_nodes.status(),
            reload=self._reloading.status(),
        )
