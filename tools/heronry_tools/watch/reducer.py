"""The one reducer of all views: events in, a snapshot out.

    state = reducer.start()
    state = reducer.after(state, event)
    state.snapshot

An event comes from the manager (`heronry_manager.core.events`), or is an observation that a feed adds (`observations`).
An event of an unknown kind changes only the number of events and the time.

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
from typing import Any

from pydantic import TypeAdapter

from heronry_dg.model import Spec
from heronry_tools.watch.configurations import NOTHING_RUNS, RunningPlan, Situations
from heronry_tools.watch.reconfigurations import done, with_outage
from heronry_tools.watch.sentences import sentence_of
from heronry_tools.watch.snapshot import (
    KEPT_EVENTS,
    Fault,
    Outage,
    Script,
    Snapshot,
    Source,
    Stage,
    Told,
)
from heronry_tools.watch.status_document import from_status

Event = Mapping[str, Any]

_STANDING = {
    "pe_suspected": "suspect",
    "pe_answered": "up",
    "pe_lost": "down",
    "pe_absent": "down",
    "pe_heard_again": "returning",
    "pe_joined": "up",
}
_STAGE: Mapping[str, Stage] = {
    "plan_requested": "planning",
    "plan_failed": "running",
    "epoch_prepared": "preparing",
    "epoch_abandoned": "planning",
    "epoch_step": "activating",
    "reconfigured": "running",
    "plan_unchanged": "running",
    "plan_kept": "running",
    "adopted": "running",
    "epoch_seen": "running",
    "unknown_epoch": "running",
    "stopped": "stopped",
}
_CHANGES_WHAT_RUNS = frozenset({"status", "runs", "reconfigured", "epoch_seen", "adopted", "unknown_epoch"})
_CHANGES_SITUATION = frozenset(
    {"manager_started", "taken_over", "phase_changed", "priority_changed", "fault_reported", "fault_cleared"}
    | {"link_limited", "link_gone", "link_back"}
)
_SHOWN_ANEW = _CHANGES_WHAT_RUNS | _CHANGES_SITUATION | (_STANDING.keys() - {"pe_suspected", "pe_answered"})


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
        """Give the state before the first event; `source` is the kind of the feed."""
        spec = self.spec
        snapshot = Snapshot(source=source, spec=spec.name, spec_digest=spec.digest, phase=spec.initial_phase())
        return State(self._situations.shown(self._situations.first(snapshot), NOTHING_RUNS))

    def after(self, state: State, event: Event) -> State:
        """Give the state after an event."""
        before, kind = state.snapshot, event.get("event", "")
        t_ns = event.get("t_ns", before.t_ns)
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
        if kind in _STANDING:
            state = _standing(state, event)
        if kind in _SHOWN_ANEW:
            state = replace(state, snapshot=self._situations.shown(state.snapshot, state.running))
        if kind in ("reconfigured", "epoch_seen"):
            state = replace(state, snapshot=done(before, state.snapshot, event))
        return state

    def all(self, events: Iterable[Event], start: State | None = None) -> State:
        """Give the state after all these events.

        start: the state before the first of them; None: the state of a feed without any event.
        """
        state = self.start() if start is None else start
        for event in events:
            state = self.after(state, event)
        return state


def _told(snapshot: Snapshot, event: Event) -> Snapshot:
    said = sentence_of(event) if "event" in event else None
    if said is None:
        return snapshot
    line = Told(snapshot.events, event["t_ns"], event["event"], *said)
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


def _standing(state: State, event: Event) -> State:
    standing = _STANDING[event["event"]]
    why = None if standing == "up" else event.get("cause")
    changes: dict[str, Any] = {"standing": standing, "why": why}
    if event["event"] == "pe_lost":
        changes |= {"epoch": None, "runs": None}
    if event.get("last_heard_ns") is not None:
        changes["last_heard_ns"] = event["last_heard_ns"]
    return _with_pe(state, event["pe"], **changes)


# What feeds add


def _feed(_: Spec, state: State, event: Event) -> State:
    return _with(state, source=event["source"], knows_why=event["knows_why"])


def _status(spec: Spec, state: State, event: Event) -> State:
    running = RunningPlan.of_document(spec, event.get("plan"))
    state = replace(state, running=running, planned=NOTHING_RUNS, prepared={})
    return replace(state, snapshot=from_status(state.snapshot, event))


@cache
def _reader() -> TypeAdapter[Snapshot]:
    """Make the adapter that reads a snapshot from JSON data.

    This is slow, so it is done only once, and only if a recording needs the adapter.
    """
    return TypeAdapter(Snapshot)


def _resumed(spec: Spec, state: State, event: Event) -> State:
    """Continue from the snapshot in a `resumed` event.

    If all earlier events have been read, too, this is the snapshot that `state` already has.
    """
    view = _reader().validate_python(event["snapshot"])
    return replace(state, snapshot=view, running=RunningPlan.of_document(spec, event["plan"]))


def _runs(spec: Spec, state: State, event: Event) -> State:
    return replace(state, running=RunningPlan.of_document(spec, event["plan"]))


def _lines_lost(_: Spec, state: State, event: Event) -> State:
    return _with(state, lost_lines=state.snapshot.lost_lines + event["lines"])


def _bus_seen(_: Spec, state: State, event: Event) -> State:
    keys = ("load", "peak", "bits_per_s", "frames_per_s", "errors", "error_state")
    return _with_bus(state, event["bus"], **{key: event[key] for key in keys})


def _heard(_: Spec, state: State, event: Event) -> State:
    pes, functions = dict(state.snapshot.pes), dict(state.snapshot.functions)
    for name, t_ns in event["pes"].items():
        pes[name] = replace(pes[name], last_heard_ns=t_ns)
    for name, (t_ns, is_heard) in event["functions"].items():
        functions[name] = replace(functions[name], heard=is_heard, heard_ns=t_ns)
    return _with(state, pes=pes, functions=functions)


def _pe_seen(_: Spec, state: State, event: Event) -> State:
    before = state.snapshot.pes.get(event["pe"])
    if before is None:
        return state
    has_rebooted = before.incarnation is not None and event["incarnation"] != before.incarnation
    keys = ("incarnation", "epoch", "runs", "hears_manager", "load_percent")
    changes = {key: event[key] for key in keys} | {"last_heard_ns": event["t_ns"]}
    return _with_pe(state, event["pe"], reboots=before.reboots + has_rebooted, **changes)


def _manager_seen(_: Spec, state: State, event: Event) -> State:
    return _with_manager(state, node=event["node"], term=event["term"], state="reigning")


# What the manager tells


def _manager_started(_: Spec, state: State, event: Event) -> State:
    state = _with(state, phase=event.get("phase"), epoch=None, next_epoch=None, faults=(), stage="starting")
    keys = ("node", "term", "advises", "key")
    return _with_manager(state, state="listening", journal=None, **{key: event[key] for key in keys})


def _taken_over(_: Spec, state: State, event: Event) -> State:
    state = _with(state, phase=event["phase"], script=Script())  # a script ends with its mastership
    return _with_manager(state, term=event["term"], state="reigning")


def _standing_by(_: Spec, state: State, event: Event) -> State:
    return _with_manager(state, term=event["term"], state="standby")


def _phase_changed(_: Spec, state: State, event: Event) -> State:
    return _with(state, phase=event["phase"])


def _fault_reported(_: Spec, state: State, event: Event) -> State:
    known = [fault for fault in state.snapshot.faults if fault.element != event["element"]]
    fault = Fault(event["element"], event["by"], event.get("code"), event.get("detail"), event["t_ns"])
    return _with(state, faults=(*known, fault))


def _fault_cleared(_: Spec, state: State, event: Event) -> State:
    return _with(state, faults=tuple(one for one in state.snapshot.faults if one.element != event["element"]))


def _module_restarted(spec: Spec, state: State, event: Event) -> State:
    snapshot, name = state.snapshot, event["element"].partition(":")[2]
    if name not in spec.modules or event["by"] not in snapshot.pes:
        return state
    module, pe = snapshot.modules[name], snapshot.pes[event["by"]]
    times = max(event["times"], module.restarts)
    state = _with(state, modules={**snapshot.modules, name: replace(module, restarts=times)})
    return _with_pe(state, event["by"], restarts=pe.restarts + times - module.restarts)


def _module_failed(spec: Spec, state: State, event: Event) -> State:
    name, modules = event["element"].partition(":")[2], state.snapshot.modules
    if name not in spec.modules:
        return state
    return _with(state, modules={**modules, name: replace(modules[name], failure=event["text"])})


def _stood_still(_: Spec, state: State, event: Event) -> State:
    return _with_pe(state, event["by"], stood_still=event["times"])


def _link(_: Spec, state: State, event: Event) -> State:
    share = event.get("share", "100%" if event["event"] == "link_back" else "gone")
    return _with_bus(state, event["bus"], link=None if share == "100%" else share)


def _channel(_: Spec, state: State, event: Event) -> State:
    bus = event["channel"].rpartition(".")[0]
    if bus not in state.snapshot.buses:
        return state
    channels = dict(state.snapshot.buses[bus].channels)
    lacking = [by for by in channels.pop(event["channel"], ()) if by != event["by"]]
    lacking += [event["by"]] if event["event"] == "channel_lost" else []
    return _with_bus(state, bus, channels={**channels, event["channel"]: tuple(lacking)})


def _priority_changed(spec: Spec, state: State, event: Event) -> State:
    changed = {name: to for name, to in state.snapshot.priorities.items() if name != event["function"]}
    is_the_specs = event["priority"] == "default" or event["function"] not in spec.functions
    return _with(state, priorities=changed if is_the_specs else {**changed, event["function"]: event["priority"]})


def _plan_ready(spec: Spec, state: State, event: Event) -> State:
    return replace(state, planned=RunningPlan.of_document(spec, event["plan"]))


def _epoch_prepared(_: Spec, state: State, event: Event) -> State:
    prepared = {**state.prepared, event["epoch"]: state.planned}
    return replace(_with(state, next_epoch=event["epoch"]), prepared=prepared)


def _epoch_abandoned(_: Spec, state: State, event: Event) -> State:
    prepared = {epoch: plan for epoch, plan in state.prepared.items() if epoch != event["epoch"]}
    return replace(_with(state, next_epoch=None), prepared=prepared)


def _reconfigured(_: Spec, state: State, event: Event) -> State:
    running = state.prepared.get(event["epoch"], state.running)
    snapshot = state.snapshot
    next_epoch = None if snapshot.next_epoch == event["epoch"] else snapshot.next_epoch
    later = {epoch: plan for epoch, plan in state.prepared.items() if epoch == next_epoch}
    state = _with(state, epoch=event["epoch"], next_epoch=next_epoch, unknown_epoch=None)
    return replace(_with_manager(state, state="reigning"), running=running, prepared=later)


def _epoch_seen(spec: Spec, state: State, event: Event) -> State:
    plan = event.get("plan")
    state = _with(state, epoch=event["epoch"], unknown_epoch=event["epoch"] if plan is None else None)
    return replace(state, running=RunningPlan.of_document(spec, plan))


def _adopted(_: Spec, state: State, event: Event) -> State:
    return _with_manager(_with(state, epoch=event["epoch"], next_epoch=None, unknown_epoch=None), state="reigning")


def _unknown_epoch(_: Spec, state: State, event: Event) -> State:
    return replace(_with(state, unknown_epoch=event["epoch"], epoch=None), running=NOTHING_RUNS)


def _script(_: Spec, state: State, event: Event) -> State:
    now = event["event"].removeprefix("script_")
    is_held = now == "taken" or (now == "refused" and state.snapshot.script.state == "held")  # an earlier script stays
    return _with(state, script=Script("held") if is_held else Script(now, event["reason"]))


def _outage(_: Spec, state: State, event: Event) -> State:
    outage = Outage(event["function"], event["from_ns"], event["to_ns"])
    return replace(state, snapshot=with_outage(state.snapshot, outage))


def _journal(_: Spec, state: State, event: Event) -> State:
    return _with_manager(state, journal=event.get("problem"))


def _bus_trouble(spec: Spec, state: State, event: Event) -> State:
    return _with_bus(state, spec.manager.bus, trouble=event["sentence"])


_STEPS: Mapping[str, Callable[[Spec, State, Event], State]] = {
    "feed": _feed,
    "status": _status,
    "resumed": _resumed,
    "runs": _runs,
    "lines_lost": _lines_lost,
    "bus_seen": _bus_seen,
    "heard": _heard,
    "pe_seen": _pe_seen,
    "manager_seen": _manager_seen,
    "epoch_seen": _epoch_seen,
    "manager_started": _manager_started,
    "taken_over": _taken_over,
    "standing_by": _standing_by,
    "phase_changed": _phase_changed,
    "fault_reported": _fault_reported,
    "fault_cleared": _fault_cleared,
    "module_restarted": _module_restarted,
    "module_failed": _module_failed,
    "stood_still": _stood_still,
    "link_limited": _link,
    "link_gone": _link,
    "link_back": _link,
    "channel_lost": _channel,
    "channel_back": _channel,
    "priority_changed": _priority_changed,
    "plan_ready": _plan_ready,
    "epoch_prepared": _epoch_prepared,
    "epoch_abandoned": _epoch_abandoned,
    "reconfigured": _reconfigured,
    "adopted": _adopted,
    "unknown_epoch": _unknown_epoch,
    "script_taken": _script,
    "script_refused": _script,
    "script_ended": _script,
    "outage": _outage,
    "journal_failed": _journal,
    "journal_kept": _journal,
    "bus_trouble": _bus_trouble,
}
