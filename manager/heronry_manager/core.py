"""The manager's core: health in, plans asked for, epochs out. No clock, socket, solver or file.

The loop of its life: *health* says which PEs are counted on; together with the latched faults that is the *situation*.
When the situation changes, a plan is asked for (`RequestPlan`, answered by `PlanReady` or `PlanFailed`, stamped, so
that an answer to an older question is dropped). A plan becomes an epoch (`Reconfiguration`), and the epoch becomes what
runs.

Desired, commanded and observed stay apart: a plan is desired; `self._current` is the last epoch whose ACTIVATE went
out; only state frames write what a PE is seen to run.

    LISTENING   for T_lease: a LEASE heard now means another manager, and this one does not start
    STARTING    LEASE and ALIVE go out; waiting for every PE, or for the start-up window to close
    REIGNING    everything else
    RETIRED     another manager with a higher term reigns: silent for ever

A fault while an epoch is being prepared abandons its number. A fault after the first ACTIVATE leaves the epoch standing
(LEASE goes on repeating its step) until the next one is ready to take its place. A manager that was paused finds frames
and deadlines waiting: the driver gives it the frames first.

What a restart does: a new term (the driver keeps the last one on disk), then the same start as ever; PEs go on with
what they run until the first new epoch.
"""

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.plan import Plan
from heronry_manager.beacon import Beacon
from heronry_manager.compilation import Compiler
from heronry_manager.events import event as make_event
from heronry_manager.exclusion import Exclusion
from heronry_manager.health import Change, Health, HealthChange, Standing
from heronry_manager.latched_faults import LatchedFaults
from heronry_manager.reconfiguration import Cause, Participant, Reconfiguration, Stage
from heronry_manager.topology import reached_by_wire
from heronry_manager.vocabulary import (
    Emit,
    ManagerAction,
    ManagerEvent,
    PlanFailed,
    PlanReady,
    RequestPlan,
    Settled,
    Stop,
)
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import REQUEST_ID, IdentificationService
from heronry_wire.identifiers import MANAGER_NODES, Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    LEASE_PERIODS,
    Activate,
    Control,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    PeState,
    Prepare,
    Reason,
    SliceBody,
    SliceHead,
    StatePage0,
    StatePage1,
    Step,
    decode_command,
    decode_emergency,
    decode_state,
    newest_epoch,
    next_epoch,
)
from heronry_wire.sansio import Received, Send, Tick, require

START_UP_WINDOW_NS = 5_000_000_000
PLAN_AGAIN_NS = 1_000_000_000
EPOCHS_PER_TERM = 16
_EPOCHS_REMEMBERED = 8
_RECENT_EVENTS = 40


class Reign(Enum):
    """Where the manager stands."""

    LISTENING = "listening"
    STARTING = "starting"
    REIGNING = "reigning"
    RETIRED = "retired"


@dataclass(slots=True)
class _Observed:
    """What the state frames of a PE have said."""

    epoch: int = 0
    digest: int = 0
    state: PeState = PeState.UNCONFIGURED
    configured: bool = False  # has been seen to run something in this incarnation


class ManagerCore:
    """The manager of one spec, on one bus (port 0)."""

    def __init__(self, spec: Spec, node: int, term: int, now_ns: int, window_ns: int = START_UP_WINDOW_NS) -> None:
        """Start listening at `now_ns` as manager `node` (126 or 127) in reign number `term`."""
        self._spec, self._node, self._term = spec, node, term
        self._bus = spec.buses[spec.manager.bus]
        self._period_ns = self._bus.heartbeat_ns
        self._compiler = Compiler(spec)
        self._health = Health(spec, now_ns, window_ns)
        self._exclusion = Exclusion(spec)
        self._reign, self._listen_until_ns = Reign.LISTENING, now_ns + LEASE_PERIODS * self._period_ns
        self._observed = {pe: _Observed() for pe in spec.pes}
        self._failed = LatchedFaults(spec)
        self._phase = spec.initial_phase()
        self._request = 0
        self._waiting_for_plan = False
        self._plan_again_ns: int | None = None
        self._causes: list[Cause] = []  # of the reconfiguration that is not done yet
        self._before = Configuration()  # what ran before the current epoch
        self._current: Reconfiguration | None = None  # the last epoch whose ACTIVATE went out
        self._next: Reconfiguration | None = None  # being prepared
        self._highest_epoch = (term - 1) * EPOCHS_PER_TERM  # the numbers of older reigns are not used again
        self._epochs: OrderedDict[int, Reconfiguration] = OrderedDict()
        self._wired = reached_by_wire(spec)
        self._beacon = Beacon(node, self._period_ns, self._listen_until_ns)
        self._identification = IdentificationService(node)
        self._pe_of_state_id = {state_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._pe_of_emcy_id = {emcy_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._manager_lease_ids = {management_id(node, Command.LEASE): node for node in MANAGER_NODES}
        self._actions: list[ManagerAction] = []
        self._recent: deque[str] = deque(maxlen=_RECENT_EVENTS)
        self._emit(
            now_ns, "manager_started", spec=spec.name, spec_digest=spec.digest, node=node, term=term, bus=self._bus.name
        )

    def hears(self, identifier: int) -> bool:
        """Tell whether frames of an identifier mean anything here; a driver may keep all others to itself."""
        return (
            identifier in self._pe_of_state_id
            or identifier in self._pe_of_emcy_id
            or identifier in self._manager_lease_ids
            or identifier == REQUEST_ID
        )

    def step(self, now_ns: int, event: ManagerEvent) -> list[ManagerAction]:
        """Take one event at `now_ns`; returns what is to be done, in order."""
        if self._reign is Reign.RETIRED:
            return []
        match event:
            case Received(frame=frame):
                self._receive(now_ns, frame)
            case Tick():
                self._tick(now_ns)
            case PlanReady():
                self._plan_ready(now_ns, event)
            case PlanFailed():
                self._plan_failed(now_ns, event)
        if self._reign in (Reign.STARTING, Reign.REIGNING):
            self._advance(now_ns)
        actions, self._actions = self._actions, []
        return actions

    def next_deadline_ns(self) -> int | None:
        """When to call with Tick at the latest."""
        if self._reign is Reign.RETIRED:
            return None
        if self._reign is Reign.LISTENING:
            return self._listen_until_ns
        deadlines = [self._beacon.next_ns, self._identification.next_ns]
        others = [self._health.next_deadline_ns(), self._plan_again_ns]
        others += [epoch.next_deadline_ns() for epoch in (self._current, self._next) if epoch is not None]
        return min(deadlines + [deadline for deadline in others if deadline is not None])

    def validate(self) -> None:
        """Check what must hold between two steps; raises InvariantError with the recent events."""
        next_, current, recent = self._next, self._current, self._recent
        if next_ is not None:
            require(next_.stage is Stage.PREPARING, "an epoch being prepared has left PREPARING: {}", recent)
            require(next_.epoch == self._highest_epoch, "an epoch number was used twice: {}", recent)
        if current is not None:
            require(current.stage is not Stage.PREPARING, "the current epoch was never activated: {}", recent)

    # Frames

    def _receive(self, now_ns: int, frame: Frame) -> None:
        if frame.extended or frame.remote or frame.error:
            return
        pe = self._pe_of_state_id.get(frame.can_id)
        if pe is not None:
            self._on_state(now_ns, pe, decode_state(frame.data))
        elif frame.can_id in self._pe_of_emcy_id:
            self._on_emergency(now_ns, self._pe_of_emcy_id[frame.can_id], decode_emergency(frame.data))
        elif frame.can_id == REQUEST_ID:
            self._identification.asked(0, frame, now_ns)
        elif frame.can_id in self._manager_lease_ids:
            self._on_lease(now_ns, self._manager_lease_ids[frame.can_id], decode_command(Command.LEASE, frame.data))

    def _on_state(self, now_ns: int, pe: str, page: StatePage0 | StatePage1 | Malformed) -> None:
        match page:
            case StatePage0():
                self._take(now_ns, self._health.heard(pe, page.incarnation, now_ns))
                self._observe(now_ns, pe, page)
            case StatePage1():
                self._take(now_ns, self._health.heard(pe, None, now_ns))
                self._on_staging(now_ns, pe, page)
            case Malformed():
                pass

    def _observe(self, now_ns: int, pe: str, page: StatePage0) -> None:
        seen = self._observed[pe]
        seen.epoch, seen.digest, seen.state = page.epoch, page.digest, page.state
        if not self._counted_on(pe):
            return
        known = self._epochs.get(page.epoch)
        if page.state is PeState.UNCONFIGURED:
            if seen.configured:
                self._exclusion.rebooted(pe)
                self._fail(now_ns, pe, "it runs nothing although it was configured")
        elif known is not None and known.compiled.digest == page.digest:
            seen.configured = True
            self._exclusion.reported(pe, known.placed)
            known.reported(pe, page.state, now_ns)
        elif seen.configured:
            self._fail(now_ns, pe, f"it runs epoch {page.epoch} with digest {page.digest:06X}, which nobody commanded")
        else:
            self._exclusion.unknown(pe)  # it joined with what another manager, or an older reign, gave it

    def _on_staging(self, now_ns: int, pe: str, page: StatePage1) -> None:
        for epoch in (self._next, self._current):
            if epoch is None or page.staged_epoch != epoch.epoch:
                continue
            has_staged = page.staged_digest == epoch.compiled.digest and page.reason is Reason.NONE
            epoch.staged(pe, has_staged=has_staged, wants_body=page.reason is Reason.INCOMPLETE, now_ns=now_ns)
            if page.reason not in (Reason.NONE, Reason.INCOMPLETE, Reason.STALE_EPOCH):
                self._emit(now_ns, "pe_refused", pe=pe, epoch=epoch.epoch, reason=page.reason.name)
                self._fail(now_ns, pe, f"it cannot stage its slice: {page.reason.name}")

    def _on_emergency(self, now_ns: int, pe: str, emergency: Emergency | Malformed) -> None:
        if isinstance(emergency, Malformed) or emergency.code is FaultCode.RESET:
            return
        element = self._failed.element(emergency.kind, emergency.index)
        if element is None or self._reign is Reign.LISTENING:  # it will be said again until somebody acknowledges it
            return
        node = self._spec.pes[pe].node_id
        heard = Control(self._term, node, Operation.ACKNOWLEDGE, emergency.kind, emergency.index)
        self._send(Command.CONTROL, heard.encode())
        if self._failed.latch(element):
            code, detail = emergency.code.name, emergency.detail
            self._emit(now_ns, "fault_reported", element=element, by=pe, detail=detail, code=code)
            self._replan(now_ns, Cause(f"{element} failed, reported by {pe}", now_ns, now_ns))

    def _on_lease(self, now_ns: int, node: int, lease: object) -> None:
        if not isinstance(lease, Lease):
            return
        if self._reign is Reign.LISTENING:
            self._retire(now_ns, node, lease, f"manager {node} already reigns on {self._bus.name} (term {lease.term})")
        elif lease.term > self._term:
            self._retire(now_ns, node, lease, f"manager {node} reigns with the higher term {lease.term}")
        elif lease.term == self._term and node < self._node:
            self._retire(now_ns, node, lease, f"manager {node} has the same term {lease.term} and goes first")

    def _retire(self, now_ns: int, node: int, lease: Lease, reason: str) -> None:
        self._reign = Reign.RETIRED
        self._emit(now_ns, "second_manager", node=node, term=lease.term)
        self._emit(now_ns, "stopped", reason=reason)
        self._actions.append(Stop(f"{reason}; stop it first, or let this one be"))

    # Time

    def _tick(self, now_ns: int) -> None:
        if self._reign is Reign.LISTENING and now_ns >= self._listen_until_ns:
            self._reign = Reign.STARTING
        if self._reign in (Reign.LISTENING, Reign.RETIRED):
            return
        self._take(now_ns, self._health.tick(now_ns))
        for epoch in (self._current, self._next):
            for pe in epoch.tick(now_ns) if epoch is not None else ():
                self._fail(now_ns, pe, "it does not acknowledge")
        self._actions += self._identification.tick(now_ns)
        if now_ns >= self._beacon.next_ns:
            self._beat(now_ns)
        first = self._reign is Reign.STARTING and not self._health.starting()
        if first or (self._plan_again_ns is not None and now_ns >= self._plan_again_ns):
            self._ask_for_plan(now_ns)

    def _beat(self, now_ns: int) -> None:
        """LEASE, ALIVE, and PING for whoever is suspect."""
        current = self._current
        lease = Lease(self._term, 0, Step.PREPARED, 0)
        if current is not None:
            lease = Lease(self._term, current.epoch, current.step, current.compiled.digest)
        counted_on = self._health.counted_on()
        suspects = [pe for pe in counted_on if self._health.standing(pe) is Standing.SUSPECT]
        self._actions += self._beacon.beat(now_ns, lease, self._nodes(counted_on), self._nodes(suspects))
        self._exclusion.named(counted_on, now_ns)

    def _nodes(self, pes: Iterable[str]) -> frozenset[int]:
        return frozenset(self._spec.pes[pe].node_id for pe in pes)

    # Health

    def _take(self, now_ns: int, changes: list[HealthChange]) -> None:
        for change in changes:
            self._take_one(now_ns, change)

    def _take_one(self, now_ns: int, change: HealthChange) -> None:
        pe, last = change.pe, change.last_heard_ns
        match change.change:
            case Change.SUSPECTED:
                silent = now_ns - last if last is not None else None
                self._emit(now_ns, "pe_suspected", pe=pe, cause=change.cause, silent_ns=silent)
                if self._reign is not Reign.LISTENING:
                    self._actions.append(self._beacon.ping(self._term, self._spec.pes[pe].node_id))
            case Change.ANSWERED:
                self._emit(now_ns, "pe_answered", pe=pe)
            case Change.LOST | Change.REBOOTED | Change.FAILED:
                if change.change is Change.REBOOTED:
                    self._exclusion.rebooted(pe)
                elif change.change is Change.LOST:
                    self._exclusion.declared_down(pe)
                self._emit(now_ns, "pe_lost", pe=pe, cause=change.cause, last_heard_ns=last)
                self._lose(now_ns, pe, Cause(f"pe:{pe}: {change.cause}", now_ns, last if last is not None else now_ns))
            case Change.ABSENT:
                self._emit(now_ns, "pe_absent", pe=pe, cause=change.cause)
                self._replan(now_ns, Cause(f"pe:{pe}: {change.cause}", now_ns, now_ns))
            case Change.HEARD_AGAIN:
                self._emit(now_ns, "pe_heard_again", pe=pe, cause=change.cause)
            case Change.JOINED:
                self._emit(now_ns, "pe_joined", pe=pe, cause=change.cause)
                self._observed[pe].configured = False
                self._replan(now_ns, Cause(f"pe:{pe} joined", now_ns, now_ns))

    def _lose(self, now_ns: int, pe: str, cause: Cause) -> None:
        self._observed[pe] = _Observed()
        if self._current is not None:
            self._current.drop(pe)
        self._replan(now_ns, cause)

    def _fail(self, now_ns: int, pe: str, cause: str) -> None:
        self._take(now_ns, self._health.fail(pe, cause, now_ns))

    def _counted_on(self, pe: str) -> bool:
        return self._health.standing(pe) in (Standing.UP, Standing.SUSPECT)

    # Plans

    def _replan(self, now_ns: int, cause: Cause) -> None:
        """The situation has changed: what is being prepared is void, and a new plan is needed."""
        self._causes.append(cause)
        if self._next is not None:
            self._next.abandon()
            self._emit(now_ns, "epoch_abandoned", epoch=self._next.epoch, reason=cause.what)
            self._next = None
        if self._reign is not Reign.LISTENING and not self._health.starting():
            self._ask_for_plan(now_ns)

    def _ask_for_plan(self, now_ns: int) -> None:
        self._reign = Reign.REIGNING
        self._request += 1
        self._waiting_for_plan, self._plan_again_ns = True, None
        down = self._down()
        running = placement(self._current.configuration) if self._current is not None else None
        self._actions.append(RequestPlan(self._request, down, self._phase, running))
        self._emit(
            now_ns,
            "plan_requested",
            request=self._request,
            down=sorted(down),
            phase=self._phase,
            causes=[cause.what for cause in self._causes],
        )

    def _down(self) -> frozenset[str]:
        return self._failed.elements | {f"pe:{pe}" for pe in self._spec.pes if not self._counted_on(pe)}

    def _settle(self) -> None:
        """Say that nothing is under way, if nothing is."""
        if self._current is not None and self._next is None and not self._waiting_for_plan:
            self._actions.append(Settled(self._down(), self._phase, placement(self._current.configuration)))

    def _plan_failed(self, now_ns: int, answer: PlanFailed) -> None:
        if answer.request != self._request:
            return
        self._waiting_for_plan, self._plan_again_ns = False, now_ns + PLAN_AGAIN_NS
        self._emit(now_ns, "plan_failed", request=answer.request, reason=answer.reason)

    def _plan_ready(self, now_ns: int, answer: PlanReady) -> None:
        if answer.request != self._request or not self._waiting_for_plan:
            return
        self._waiting_for_plan = False
        decide_ns = now_ns - self._causes[-1].known_ns if self._causes else 0
        self._emit(now_ns, "plan_ready", request=answer.request, plan=answer.plan.document(), decide_ns=decide_ns)
        if self._runs_already(answer.plan.configuration):
            self._causes.clear()
            self._emit(now_ns, "plan_unchanged", request=answer.request)
            self._settle()
        else:
            self._prepare(now_ns, answer.plan)

    def _runs_already(self, configuration: Configuration) -> bool:
        current = self._current
        if current is None or current.stage is not Stage.DONE or current.configuration != configuration:
            return False
        return all(self._observed[pe].epoch == current.epoch for pe in self._health.counted_on())

    def _prepare(self, now_ns: int, plan: Plan) -> None:
        compiled = self._compiler.configuration(plan.configuration)
        observed = (seen.epoch for seen in self._observed.values())
        self._highest_epoch = next_epoch(newest_epoch((self._highest_epoch, *observed)))
        participants = [self._participant(pe) for pe in self._health.counted_on()]
        self._next = Reconfiguration(
            term=self._term,
            epoch=self._highest_epoch,
            configuration=plan.configuration,
            compiled=compiled,
            placed=self._exclusion.tokens(plan.configuration),
            participants=participants,
            bitrate=self._bus.bitrate,
            started_ns=now_ns,
            causes=tuple(self._causes),
        )
        size = sum(len(body) for body in compiled.slices.values())
        pes = [participant.pe for participant in participants]
        self._emit(
            now_ns, "epoch_prepared", epoch=self._highest_epoch, digest=f"{compiled.digest:06X}", pes=pes, bytes=size
        )

    def _participant(self, pe: str) -> Participant:
        seen = self._observed[pe]
        known = self._epochs.get(seen.epoch)
        node = self._spec.pes[pe].node_id
        runs = known.compiled.slice_digests[node] if known is not None and seen.configured else None
        return Participant(
            pe=pe, node=node, period_ns=self._health.period_ns(pe), awaited=pe in self._wired, runs_digest=runs
        )

    # Epochs

    def _advance(self, now_ns: int) -> None:
        """Move the epochs as far as they will go, then send what they have to say."""
        if self._next is not None and self._next.all_staged():
            self._activate(now_ns, self._next)
        current = self._current
        if current is not None:
            self._free(current, now_ns)
            broken = current.stage is Stage.BREAKING and current.all_broken() and current.identifiers_free_ns is None
            if broken or (current.stage is Stage.HOLDING and current.demux_free_ns is None):
                current.go(now_ns)
                self._emit_step(now_ns, current)
            if current.stage is Stage.GOING and current.all_active():
                current.finish(now_ns)
                self._emit_reconfigured(now_ns, current)
                self._settle()
        for epoch in (self._current, self._next):
            self._flush(epoch)

    def _activate(self, now_ns: int, epoch: Reconfiguration) -> None:
        must_break = self._exclusion.must_break(epoch.placed, self._health.counted_on())
        self._free(epoch, now_ns)
        self._exclusion.activated(epoch.placed)
        self._before = self._current.configuration if self._current is not None else Configuration()
        self._current, self._next = epoch, None
        self._epochs[epoch.epoch] = epoch
        if len(self._epochs) > _EPOCHS_REMEMBERED:
            self._epochs.popitem(last=False)
        epoch.activate(must_break, now_ns)
        self._emit_step(now_ns, epoch)

    def _free(self, epoch: Reconfiguration, now_ns: int) -> None:
        """Work out how long what this epoch needs may still be held by PEs that are not counted on."""
        if epoch.stage in (Stage.DONE, Stage.GOING):
            return
        counted_on = self._health.counted_on()
        epoch.identifiers_free_ns = self._exclusion.identifiers_free_ns(epoch.placed, counted_on, now_ns)
        epoch.demux_free_ns = self._exclusion.demux_free_ns(epoch.placed, counted_on, now_ns)

    def _flush(self, epoch: Reconfiguration | None) -> None:
        if epoch is None:
            return
        for message in epoch.outbox:
            self._send(_COMMAND_OF[type(message)], message.encode())
        epoch.outbox.clear()

    # Output

    def _emit_step(self, now_ns: int, epoch: Reconfiguration) -> None:
        waiting = sorted(epoch.must_break) if epoch.stage is Stage.BREAKING else []
        self._emit(now_ns, "epoch_step", epoch=epoch.epoch, step=epoch.step.name, waiting_for=waiting)

    def _emit_reconfigured(self, now_ns: int, epoch: Reconfiguration) -> None:
        before, after = self._before.modules, epoch.configuration.modules
        times = epoch.times
        staged_ns = times.staged_ns or now_ns
        first = min(epoch.causes, key=lambda cause: cause.known_ns)
        self._emit(
            now_ns,
            "reconfigured",
            epoch=epoch.epoch,
            causes=[cause.what for cause in epoch.causes],
            times_ns={
                "detect": first.known_ns - first.since_ns,
                "decide": times.prepared_ns - first.known_ns,
                "distribute": staged_ns - times.prepared_ns,
                "activate": now_ns - staged_ns,
            },
            moved=sorted(m for m in before.keys() & after.keys() if before[m].pe != after[m].pe),
            started=sorted(after.keys() - before.keys()),
            stopped=sorted(before.keys() - after.keys()),
        )
        self._causes = [cause for cause in self._causes if cause not in epoch.causes]

    def _send(self, command: Command, data: bytes) -> None:
        self._actions.append(Send(0, Frame(management_id(self._node, command), data)))

    def _emit(self, now_ns: int, kind: str, **data: Any) -> None:
        self._recent.append(f"{now_ns} {kind}")
        self._actions.append(Emit(make_event(kind, now_ns, **data)))


_COMMAND_OF: dict[type[Prepare | SliceHead | SliceBody | Activate], Command] = {
    Prepare: Command.PREPARE,
    SliceHead: Command.SLICE,
    SliceBody: Command.SLICE,
    Activate: Command.ACTIVATE,
}
