"""Events as views list them: a severity and one sentence each.

Some kinds of events have their sentence in this file (`_OWN`). Any other event gets its sentence from
`reports.story`, if there is one that needs only this event. All other events are not listed;
among these are `pe_suspected` and `pe_answered`, since a busy computer delays answers often.
"""

from collections.abc import Callable, Mapping
from typing import Any

from heronry_tools.reports.story import Tone, plain_line
from heronry_tools.watch.snapshot import Severity

_SEVERITIES: Mapping[Tone, Severity] = {
    "bad": "error",
    "fault": "warning",
    "title": "notice",
    "plain": "notice",
    "good": "good",
    "quiet": "detail",
}


def sentence_of(event: Mapping[str, Any]) -> tuple[Severity, str] | None:
    """Give severity and sentence of an event; None for an event that is not listed."""
    kind = event["event"]
    if kind in _OWN:
        severity, tell = _OWN[kind]
        return severity, tell(event)
    line = plain_line(event)
    return None if line is None else (_SEVERITIES[line.tone], line.text)


def _milliseconds(times_ns: Mapping[str, int | None]) -> str:
    known = (f"{name} {ns / 1e6:.1f} ms" for name, ns in times_ns.items() if ns is not None)
    return ", ".join(known) or "its times are not known"


def _reconfigured(event: Mapping[str, Any]) -> str:
    causes = event.get("causes") or ("a reason that the bus does not tell",)
    more = f", and {len(causes) - 1} more" if len(causes) > 1 else ""
    return f"epoch {event['epoch']} runs, because of {causes[0]}{more}: {_milliseconds(event['times_ns'])}"


def _planned(event: Mapping[str, Any]) -> str:
    served = [name for name, one in event["plan"].get("functions", {}).items() if one["served"]]
    return f"a plan is ready after {event['decide_ns'] / 1e6:.1f} ms: it serves {', '.join(served) or 'nothing'}"


def _outage(event: Mapping[str, Any]) -> str:
    if event["to_ns"] is None:
        return f"{event['function']} is not heard on the bus"
    return f"{event['function']} is heard again, after {(event['to_ns'] - event['from_ns']) / 1e6:.0f} ms of silence"


def _requested(event: Mapping[str, Any]) -> str:
    return f"a plan with {', '.join(event['down']) or 'no element'} down is requested: {'; '.join(event['causes'])}"


def _control_paths(event: Mapping[str, Any]) -> str:
    open_ones = [plant for plant, state in event["plants"].items() if state != "on_path"]
    return f"control loops that are open: {', '.join(open_ones) or 'none'}"


def _process(event: Mapping[str, Any]) -> str:
    return f"{event['pe']} is {event['what']} (process {event['pid']})"


def _taken_over(event: Mapping[str, Any]) -> str:
    return f"the standby manager takes over with term {event['term']}"


_OWN: Mapping[str, tuple[Severity, Callable[[Mapping[str, Any]], str]]] = {
    "reconfigured": ("good", _reconfigured),
    "epoch_seen": ("good", _reconfigured),
    "unknown_epoch": ("warning", lambda e: f"epoch {e['epoch']} runs, and its configuration is not known"),
    "plan_requested": ("detail", _requested),
    "plan_ready": ("detail", _planned),
    "plan_unchanged": ("detail", lambda _: "everything already runs as planned"),
    "plan_kept": ("detail", lambda _: "the optimal plan is not better, so the running configuration stays"),
    "epoch_prepared": ("detail", lambda e: f"epoch {e['epoch']} is prepared on {', '.join(e['pes'])}"),
    "epoch_step": ("detail", lambda e: f"epoch {e['epoch']}: ACTIVATE with {e['step']} is sent"),
    "epoch_abandoned": ("warning", lambda e: f"epoch {e['epoch']} is given up: {e['reason']}"),
    "pe_lost": ("error", lambda e: f"{e['pe']} is lost: {e['cause']}"),
    "pe_joined": ("good", lambda e: f"{e['pe']} joins: {e['cause']}"),
    "outage": ("warning", _outage),
    "control_paths": ("detail", _control_paths),
    "process": ("notice", _process),
    "stood_still": ("warning", lambda e: f"{e['by']} stood still for {e['for_ns'] / 1e6:.0f} ms"),
    "taken_over": ("notice", _taken_over),
    "stopped": ("notice", lambda e: f"the manager ends: {e['reason']}"),
    "lines_lost": ("error", lambda e: f"{e['lines']} events are missing here: this reader was too slow"),
    "manager_seen": ("notice", lambda e: f"manager {e['node']} is active, term {e['term']}"),
}
