"""Events as views list them: a severity and one sentence each.

Some kinds of events have their sentence in this file (`_OWN`). Any other event gets its sentence from
`reports.plain_lines`, if there is one that needs only this event. All other events are not listed;
among these are `pe_suspected` and `pe_answered`, since a busy computer delays answers often.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from heronry_manager import events
from heronry_tools.reports.plain_lines import Tone, plain_line
from heronry_tools.watch.snapshot import Severity

_E = TypeVar("_E", bound=events.Event)
_Sentence = tuple[Severity, Callable[[Any], str]]
_SEVERITIES: Mapping[Tone, Severity] = {
    "bad": "error",
    "fault": "warning",
    "title": "notice",
    "plain": "notice",
    "good": "good",
    "quiet": "detail",
}


def sentence_of(event: events.Event) -> tuple[Severity, str] | None:
    """Return severity and sentence of an event; None for an event that is not listed."""
    if type(event) in _OWN:
        severity, tell = _OWN[type(event)]
        return severity, tell(event)
    line = plain_line(event)
    return None if line is None else (_SEVERITIES[line.tone], line.text)


def _milliseconds(times_ns: events.Times) -> str:
    known = (f"{name} {ns / 1e6:.1f} ms" for name, ns in times_ns.by_name().items() if ns is not None)
    return ", ".join(known) or "its times are not known"


def _reconfigured(event: events.Reconfigured) -> str:
    return _runs(event.epoch, event.causes, event.times_ns)


def _epoch_seen(event: events.EpochSeen) -> str:
    return _runs(event.epoch, ("a reason that the bus does not tell",), event.times_ns)


def _runs(epoch: int, causes: Sequence[str], times_ns: events.Times) -> str:
    more = f", and {len(causes) - 1} more" if len(causes) > 1 else ""
    why = f", because of {causes[0]}{more}" if causes else ""
    return f"epoch {epoch} runs{why}: {_milliseconds(times_ns)}"


def _planned(event: events.PlanReady) -> str:
    served = ", ".join(event.plan.served()) or "nothing"
    return f"a plan is ready after {event.decide_ns / 1e6:.1f} ms: it serves {served}"


def _outage(event: events.Outage) -> str:
    if event.to_ns is None:
        return f"{event.function} is not heard on the bus"
    return f"{event.function} is heard again, after {(event.to_ns - event.from_ns) / 1e6:.0f} ms of silence"


def _requested(event: events.PlanRequested) -> str:
    return f"a plan with {', '.join(event.down) or 'no element'} down is requested: {'; '.join(event.causes)}"


def _control_paths(event: events.ControlPaths) -> str:
    open_ones = [plant for plant, state in event.plants.items() if state != "on_path"]
    return f"control loops that are open: {', '.join(open_ones) or 'none'}"


def _process(event: events.Process) -> str:
    return f"{event.pe} is {event.what} (process {event.pid})"


def _taken_over(event: events.TakenOver) -> str:
    return f"the standby manager takes over with term {event.term}"


def _says(kind: type[_E], severity: Severity, sentence: Callable[[_E], str]) -> tuple[type[events.Event], _Sentence]:
    return kind, (severity, sentence)


_OWN = dict(
    [
        _says(events.Reconfigured, "good", _reconfigured),
        _says(events.EpochSeen, "good", _epoch_seen),
        _says(events.UnknownEpoch, "warning", lambda e: f"epoch {e.epoch} runs, and its configuration is not known"),
        _says(events.PlanRequested, "detail", _requested),
        _says(events.PlanReady, "detail", _planned),
        _says(events.PlanUnchanged, "detail", lambda _: "everything already runs as planned"),
        _says(
            events.PlanKept, "detail", lambda _: "the optimal plan is not better, so the running configuration stays"
        ),
        _says(events.EpochPrepared, "detail", lambda e: f"epoch {e.epoch} is prepared on {', '.join(e.pes)}"),
        _says(events.EpochStep, "detail", lambda e: f"epoch {e.epoch}: ACTIVATE with {e.step} is sent"),
        _says(events.EpochAbandoned, "warning", lambda e: f"epoch {e.epoch} is given up: {e.reason}"),
        _says(events.PeLost, "error", lambda e: f"{e.pe} is lost: {e.cause}"),
        _says(events.PeJoined, "good", lambda e: f"{e.pe} joins: {e.cause}"),
        _says(events.Outage, "warning", _outage),
        _says(events.ControlPaths, "detail", _control_paths),
        _says(events.Process, "notice", _process),
        _says(events.StoodStill, "warning", lambda e: f"{e.by} stood still for {e.for_ns / 1e6:.0f} ms"),
        _says(events.TakenOver, "notice", _taken_over),
        _says(events.Stopped, "notice", lambda e: f"the manager ends: {e.reason}"),
        _says(events.LinesLost, "error", lambda e: f"{e.lines} events are missing here: this reader was too slow"),
        _says(events.ManagerSeen, "notice", lambda e: f"manager {e.node} is active, term {e.term}"),
    ]
)
