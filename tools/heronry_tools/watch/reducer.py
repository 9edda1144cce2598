"""The one reducer of all views: events in, a snapshot out.

    state = reducer.start()
    state = reducer.after(state, event)
    state.snapshot

An event (`heronry_manager.events`) comes from the manager, or is an observation that a feed adds. An event of an
unknown kind changes only the number of events and the time.

The reducer is pure: it reads no clock and never changes a state. So the same events give the same snapshot, whether
they come live or from a recording.

The running configuration is that of the last event `reconfigured`, `runs`, `epoch_seen`, `status` or `resumed`; after
`unknown_epoch` it is not known. A plan that is ready, and the plan of an epoch that is being prepared, are kept until
the epoch runs. The situation (what is down) is updated with every event that changes it, so that the graph shows a loss
before the plan for this loss runs.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Literal, TypeVar

from pydantic import TypeAdapter, ValidationError

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.events import Event
from heronry_tools.watch.configurations import NOTHING_RUNS, RunningPlan, Situations
from heronry_tools.watch.reconfigurations import done, with_outage
from heronry_tools.watch.sentences import sentence_of
from heronry_tools.watch.snapshot import (
    KEPT_EVENTS,
    Fault,
    Outage,
    Script,
    Silence,
    Snapshot,
    Source,
    Stage,
    Standing,
    Told,
)
from heronry_tools.watch.status_document import from_status

_E = TypeVar("_E", bound=Event)
_Step = Callable[[Spec, "State", Any], "State"]
_STANDING: Mapping[type[Event], Standing] = {
    events.PeSuspected: "suspect",
    events.PeAnswered: "up",
    events.PeLost: "down",
    events.PeAbsent: "down",
    events.PeHeardAgain: "returning",
    events.PeJoined: "up",
}
_STAGE: Mapping[type[Event], Stage] = {
    events.PlanRequested: "planning",
    events.PlanFailed: "running",
    events.EpochPrepared: "preparing",
    events.EpochAbandoned: "planning",
    events.EpochStep: "activating",
    events.Reconfigured: "running",
    events.PlanUnchanged: "running",
    events.PlanKept: "running",
    events.Adopted: "running",
    events.EpochSeen: "running",
    events.UnknownEpoch: "running",
    events.Stopped: "stopped",
}
_CHANGES_WHAT_RUNS = (
    events.Status,
    events.Runs,
    events.Reconfigured,
    events.EpochSeen,
    events.Adopted,
    events.UnknownEpoch,
)
_CHANGES_SITUATION = (
    events.ManagerStarted,
    events.TakenOver,
    events.PhaseChanged,
    events.PriorityChanged,
    events.FaultReported,
    events.FaultCleared,
    events.LinkLimited,
    events.LinkGone,
    events.LinkBack,
)
_CHANGES_PES = (events.PeLost, events.PeAbsent, events.PeHeardAgain, events.PeJoined)
_SHOWN_ANEW = (*_CHANGES_WHAT_RUNS, *_CHANGES_SITUATION, *_CHANGES_PES)


@dataclass(frozen=True, slots=True)
class State:
    """A snapshot, with the plans from which the reducer makes the next snapshot.

    These are the running plan, the planned one, and those that are prepared (by epoch).
    """

    snapshot: Snapshot
    running: RunningPlan = NOTHING_RUNS
    planned: RunningPlan = NOTHING_RUNS
    prepared: Mapping[int, RunningPlan] = field(default_factory=dict)  # by epoch


class Reducer:
    """Computes the state that a view shows of one spec's system, from the state before and one event."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._situations = Situations(spec)

    def start(self, source: Source = "manager") -> State:
        """Return the state before the first event; `source` is the kind of the feed."""
        spec = self.spec
        snapshot = Snapshot(source=source, spec=spec.name, spec_digest=spec.digest, phase=spec.initial_phase())
        return State(self._situations.shown(self._situations.first(snapshot), NOTHING_RUNS))

    def after(self, state: State, event: Event) -> State:
        """Return the state after an event."""
        before, kind, t_ns = state.snapshot, type(event), event.t_ns
        snapshot = replace(
            before,
            events=before.events + 1,
            t_ns=max(t_ns, before.t_ns),
            began_ns=t_ns if before.began_ns is None else before.began_ns,
            stage=_STAGE.get(kind, before.stage),
        )
        state = replace(state, snapshot=_told(snapshot, event))
        step = _STEPS.get(kind)
        if step is not None:
            state = step(self.spec, state, event)
        if isinstance(event, _PeChanged):
            state = _standing(state, event)
        if isinstance(event, _SHOWN_ANEW):
            state = replace(state, snapshot=self._situations.shown(state.snapshot, state.running))
        if isinstance(event, events.Adopted | events.EpochSeen | events.Reconfigured):
            state = replace(state, snapshot=done(before, state.snapshot, event))
        return state

    def all(self, told: Iterable[Event], start: State | None = None) -> State:
        """Return the state after all these events (`told`).

        start: the state before the first of them; None: the state of a feed without any event.
        """
        state = self.start() if start is None else start
        for event in told:
            state = self.after(state, event)
        return state


def _told(snapshot: Snapshot, event: Event) -> Snapshot:
    said = sentence_of(event)
    if said is None:
        return snapshot
    line = Told(snapshot.events, event.t_ns, event.kind, *said)
    return replace(snapshot, told=(*snapshot.told[1 - KEPT_EVENTS :], line))


def _with(state: State, /, **changes: Any) -> State:
    return replace(state, snapshot=replace(state.snapshot, **changes))


def _with_pe(state: State, name: str, /, **changes: Any) -> State:
    pes = state.snapshot.pes
    if name not in pes:
        return state
    return _with(state, pes={**pes, name: replace(pes[name], **changes)})


def _with_bus(state: State, name: str, /, **changes: Any) -> State:
    buses = state.snapshot.buses
    if name not in buses:
        return state
    return _with(state, buses={**buses, name: replace(buses[name], **changes)})


def _with_manager(state: State, /, **changes: Any) -> State:
    return _with(state, manager=replace(state.snapshot.manager, **changes))


_PeChanged = (
    events.PeSuspected | events.PeAnswered | events.PeLost | events.PeAbsent | events.PeHeardAgain | events.PeJoined
)


def _standing(state: State, event: _PeChanged) -> State:
    standing = _STANDING[type(event)]
    cause = None if isinstance(event, events.PeAnswered) else event.cause
    changes: dict[str, Any] = {"standing": standing, "why": None if standing == "up" else cause}
    if isinstance(event, events.PeLost):
        changes |= {"epoch": None, "runs": None}
        if event.last_heard_ns is not None:
            changes["last_heard_ns"] = event.last_heard_ns
    return _with_pe(state, event.pe, **changes)


# What feeds add


def _feed(_: Spec, state: State, event: events.Feed) -> State:
    return _with(state, source=event.source, knows_why=event.knows_why)


def _status(spec: Spec, state: State, event: events.Status) -> State:
    snapshot = from_status(state.snapshot, event)
    if snapshot is None:
        return state
    return State(snapshot, RunningPlan.of(spec, event.plan))


@cache
def _reader() -> TypeAdapter[Snapshot]:
    """Make the adapter that reads a snapshot from JSON data.

    This is slow, so it is done only once, and only if a recording needs the adapter.
    """
    return TypeAdapter(Snapshot)


def _resumed(spec: Spec, state: State, event: events.Resumed) -> State:
    """Continue from the snapshot in a `resumed` event.

    If all earlier events have been read, too, this is the snapshot that `state` already has. A snapshot of another
    form, or with the elements of another spec, is damaged, and the state stays as it is.
    """
    try:
        view = _reader().validate_python(event.snapshot)
    except ValidationError:
        return state
    told = (view.pes, view.buses, view.functions, view.modules)
    known = (spec.pes, spec.buses, spec.functions, spec.modules)
    if any(these.keys() != those.keys() for these, those in zip(told, known, strict=True)):
        return state
    return replace(state, snapshot=view, running=RunningPlan.of(spec, event.plan))


def _runs(spec: Spec, state: State, event: events.Runs) -> State:
    return replace(state, running=RunningPlan.of(spec, event.plan))


def _lines_lost(_: Spec, state: State, event: events.LinesLost) -> State:
    return _with(state, lost_lines=state.snapshot.lost_lines + event.lines)


def _bus_seen(_: Spec, state: State, event: events.BusSeen) -> State:
    return _with_bus(
        state,
        event.bus,
        load=event.load,
        peak=event.peak,
        bits_per_s=event.bits_per_s,
        frames_per_s=event.frames_per_s,
        errors=event.errors,
        error_state=event.error_state,
    )


def _heard(_: Spec, state: State, event: events.Heard) -> State:
    pes, functions = dict(state.snapshot.pes), dict(state.snapshot.functions)
    for name, t_ns in event.pes.items():
        if name in pes:
            pes[name] = replace(pes[name], last_heard_ns=t_ns)
    for name, (t_ns, is_heard) in event.functions.items():
        if name in functions:
            functions[name] = replace(functions[name], heard=is_heard, heard_ns=t_ns)
    return _with(state, pes=pes, functions=functions)


def _pe_seen(_: Spec, state: State, event: events.PeSeen) -> State:
    before = state.snapshot.pes.get(event.pe)
    if before is None:
        return state
    has_rebooted = before.incarnation is not None and event.incarnation != before.incarnation
    return _with_pe(
        state,
        event.pe,
        reboots=before.reboots + has_rebooted,
        incarnation=event.incarnation,
        epoch=event.epoch,
        runs=event.runs,
        hears_manager=event.hears_manager,
        load_percent=event.load_percent,
        last_heard_ns=event.t_ns,
    )


def _manager_seen(_: Spec, state: State, event: events.ManagerSeen) -> State:
    return _with_manager(state, node=event.node, term=event.term, state="active")


# What the manager tells


def _manager_started(_: Spec, state: State, event: events.ManagerStarted) -> State:
    state = _with(state, phase=event.phase, epoch=None, next_epoch=None, faults=(), silences=(), stage="starting")
    return _with_manager(
        state,
        state="listening",
        journal=None,
        node=event.node,
        term=event.term,
        advises=event.advises,
        key=event.key,
    )


def _taken_over(_: Spec, state: State, event: events.TakenOver) -> State:
    state = _with(state, phase=event.phase, silences=(), script=Script())  # a script ends with its mastership
    return _with_manager(state, term=event.term, state="active")


def _standing_by(_: Spec, state: State, event: events.StandingBy) -> State:
    return _with_manager(state, term=event.term, state="standby")


def _phase_changed(_: Spec, state: State, event: events.PhaseChanged) -> State:
    return _with(state, phase=event.phase)


def _fault_reported(_: Spec, state: State, event: events.FaultReported) -> State:
    known = [fault for fault in state.snapshot.faults if fault.element != event.element]
    fault = Fault(event.element, event.by, event.code, event.detail, event.t_ns)
    return _with(state, faults=(*known, fault))


def _fault_cleared(_: Spec, state: State, event: events.FaultCleared) -> State:
    return _with(state, faults=tuple(one for one in state.snapshot.faults if one.element != event.element))


def _silence(_: Spec, state: State, event: events.InputSilent | events.OutputSilent | events.SilenceOver) -> State:
    silences, producer = state.snapshot.silences, event.producer if isinstance(event, events.InputSilent) else None
    if isinstance(event, events.SilenceOver):
        key = (event.module, event.by, event.what, event.variable)
        return _with(state, silences=tuple(s for s in silences if (s.module, s.by, s.what, s.variable) != key))
    what: Literal["input", "output"] = "output" if producer is None else "input"
    silence = Silence(event.module, event.by, what, event.variable, producer, event.t_ns)
    return _with(state, silences=(*silences, silence))


def _module_restarted(spec: Spec, state: State, event: events.ModuleRestarted) -> State:
    snapshot, name = state.snapshot, event.element.partition(":")[2]
    if name not in spec.modules or event.by not in snapshot.pes:
        return state
    module, pe = snapshot.modules[name], snapshot.pes[event.by]
    times = max(event.times, module.restarts)
    state = _with(state, modules={**snapshot.modules, name: replace(module, restarts=times)})
    return _with_pe(state, event.by, restarts=pe.restarts + times - module.restarts)


def _module_failed(spec: Spec, state: State, event: events.ModuleFailed) -> State:
    name, modules = event.element.partition(":")[2], state.snapshot.modules
    if name not in spec.modules:
        return state
    return _with(state, modules={**modules, name: replace(modules[name], failure=event.text)})


def _stood_still(_: Spec, state: State, event: events.StoodStill) -> State:
    return _with_pe(state, event.by, stood_still=event.times)


def _link(_: Spec, state: State, event: events.LinkLimited | events.LinkGone | events.LinkBack) -> State:
    match event:
        case events.LinkLimited(share=share):
            return _with_bus(state, event.bus, link=None if share == "100%" else share)
        case events.LinkGone():
            return _with_bus(state, event.bus, link="gone")
        case events.LinkBack():
            return _with_bus(state, event.bus, link=None)


def _channel(_: Spec, state: State, event: events.ChannelLost | events.ChannelBack) -> State:
    bus = event.channel.rpartition(".")[0]
    if bus not in state.snapshot.buses:
        return state
    channels = dict(state.snapshot.buses[bus].channels)
    lacking = [by for by in channels.pop(event.channel, ()) if by != event.by]
    lacking += [event.by] if isinstance(event, events.ChannelLost) else []
    return _with_bus(state, bus, channels={**channels, event.channel: tuple(lacking)})


def _priority_changed(spec: Spec, state: State, event: events.PriorityChanged) -> State:
    changed = {name: to for name, to in state.snapshot.priorities.items() if name != event.function}
    is_the_specs = event.priority == "default" or event.function not in spec.functions
    return _with(state, priorities=changed if is_the_specs else {**changed, event.function: event.priority})


def _plan_ready(spec: Spec, state: State, event: events.PlanReady) -> State:
    return replace(state, planned=RunningPlan.of(spec, event.plan))


def _epoch_prepared(_: Spec, state: State, event: events.EpochPrepared) -> State:
    prepared = {**state.prepared, event.epoch: state.planned}
    return replace(_with(state, next_epoch=event.epoch), prepared=prepared)


def _epoch_abandoned(_: Spec, state: State, event: events.EpochAbandoned) -> State:
    prepared = {epoch: plan for epoch, plan in state.prepared.items() if epoch != event.epoch}
    return replace(_with(state, next_epoch=None), prepared=prepared)


def _reconfigured(_: Spec, state: State, event: events.Reconfigured) -> State:
    running = state.prepared.get(event.epoch, state.running)
    snapshot = state.snapshot
    next_epoch = None if snapshot.next_epoch == event.epoch else snapshot.next_epoch
    later = {epoch: plan for epoch, plan in state.prepared.items() if epoch == next_epoch}
    state = _with(state, epoch=event.epoch, next_epoch=next_epoch, unknown_epoch=None)
    return replace(_with_manager(state, state="active"), running=running, prepared=later)


def _epoch_seen(spec: Spec, state: State, event: events.EpochSeen) -> State:
    plan = event.plan
    state = _with(state, epoch=event.epoch, unknown_epoch=event.epoch if plan is None else None)
    return replace(state, running=RunningPlan.of(spec, plan))


def _adopted(_: Spec, state: State, event: events.Adopted) -> State:
    return _with_manager(_with(state, epoch=event.epoch, next_epoch=None, unknown_epoch=None), state="active")


def _unknown_epoch(_: Spec, state: State, event: events.UnknownEpoch) -> State:
    return replace(_with(state, unknown_epoch=event.epoch, epoch=None), running=NOTHING_RUNS)


def _script(_: Spec, state: State, event: events.ScriptTaken | events.ScriptRefused | events.ScriptEnded) -> State:
    match event:
        case events.ScriptTaken():
            return _with(state, script=Script("held"))
        case events.ScriptRefused() if state.snapshot.script.state == "held":  # an earlier script stays
            return _with(state, script=Script("held"))
        case events.ScriptRefused():
            return _with(state, script=Script("refused", event.reason))
        case events.ScriptEnded():
            return _with(state, script=Script("ended", event.reason))


def _outage(_: Spec, state: State, event: events.Outage) -> State:
    outage = Outage(event.function, event.from_ns, event.to_ns)
    return replace(state, snapshot=with_outage(state.snapshot, outage))


def _journal(_: Spec, state: State, event: events.JournalFailed | events.JournalKept) -> State:
    return _with_manager(state, journal=event.problem if isinstance(event, events.JournalFailed) else None)


def _bus_trouble(spec: Spec, state: State, event: events.BusTrouble) -> State:
    return _with_bus(state, spec.manager.bus, trouble=event.sentence)


def _on(kind: type[_E], step: Callable[[Spec, State, _E], State]) -> tuple[type[Event], _Step]:
    return kind, step


_STEPS: Mapping[type[Event], _Step] = dict(
    [
        _on(events.Feed, _feed),
        _on(events.Status, _status),
        _on(events.Resumed, _resumed),
        _on(events.Runs, _runs),
        _on(events.LinesLost, _lines_lost),
        _on(events.BusSeen, _bus_seen),
        _on(events.Heard, _heard),
        _on(events.PeSeen, _pe_seen),
        _on(events.ManagerSeen, _manager_seen),
        _on(events.EpochSeen, _epoch_seen),
        _on(events.ManagerStarted, _manager_started),
        _on(events.TakenOver, _taken_over),
        _on(events.StandingBy, _standing_by),
        _on(events.PhaseChanged, _phase_changed),
        _on(events.FaultReported, _fault_reported),
        _on(events.FaultCleared, _fault_cleared),
        _on(events.InputSilent, _silence),
        _on(events.OutputSilent, _silence),
        _on(events.SilenceOver, _silence),
        _on(events.ModuleRestarted, _module_restarted),
        _on(events.ModuleFailed, _module_failed),
        _on(events.StoodStill, _stood_still),
        _on(events.LinkLimited, _link),
        _on(events.LinkGone, _link),
        _on(events.LinkBack, _link),
        _on(events.ChannelLost, _channel),
        _on(events.ChannelBack, _channel),
        _on(events.PriorityChanged, _priority_changed),
        _on(events.PlanReady, _plan_ready),
        _on(events.EpochPrepared, _epoch_prepared),
        _on(events.EpochAbandoned, _epoch_abandoned),
        _on(events.Reconfigured, _reconfigured),
        _on(events.Adopted, _adopted),
        _on(events.UnknownEpoch, _unknown_epoch),
        _on(events.ScriptTaken, _script),
        _on(events.ScriptRefused, _script),
        _on(events.ScriptEnded, _script),
        _on(events.Outage, _outage),
        _on(events.JournalFailed, _journal),
        _on(events.JournalKept, _journal),
        _on(events.BusTrouble, _bus_trouble),
    ]
)
