"""The decision trace of a flight: the scenario's actions and the manager's decisions, one line each, to be compared.

The trace has no times of decisions and no plans. So it changes when a decision changes, and not when a frame gets a
byte longer. (Expectations verify that decisions come in time.) Events `pe_suspected` are left out, since most suspected
PEs answer.

The golden trace of FILE.scenario is FILE.scenario.golden beside it.
"""

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from heronry_tools.console.errors import UserError

_LINES: Mapping[str, str] = {
    "manager_started": "manager {node} starts, term {term}",
    "second_manager": "manager {node} is active too, term {term}",
    "pe_lost": "{pe} is lost: {cause}",
    "pe_absent": "{pe} is absent: {cause}",
    "pe_heard_again": "{pe} is heard again: {cause}",
    "pe_joined": "{pe} joins: {cause}",
    "module_restarted": "{element} failed and is restarted on {by} ({times})",
    "fault_reported": "{element} has failed, reported by {by}",
    "fault_cleared": "{element} is cleared by {by}",
    "link_limited": "{bus} has {share} of its bandwidth, reported by {by}",
    "link_gone": "{bus} is gone, reported by {by}",
    "link_back": "{bus} is back, reported by {by}",
    "channel_lost": "channel {channel} carries nothing, reported by {by}",
    "channel_back": "channel {channel} is back, reported by {by}",
    "phase_changed": "phase {phase}, requested by {by}",
    "suspicion": "{element} is suspected by a module on {by}: {evidence}",
    "suspicion_assessed": "{element} was suspected: {found}",
    "unknown_element": "module:{module} on {by} reports an element that the spec does not have",
    "unknown_output": "module:{module} on {by} gives a misspelt output: the log of its agent names it",
    "disagreement": "two inputs of module:{module} disagree, reported by {by}",
    "agreement": "the inputs of module:{module} agree again",
    "priority_changed": "priority {priority} of {function}, requested by {by}",
    "priority_refused": "priority {priority} of {function}, requested by {by}, is refused: {why}",
    "adopted": "epoch {epoch} is adopted as it runs",
    "plan_failed": "no plan: {reason}",
    "plan_unchanged": "everything runs as planned",
    "plan_kept": "the running configuration is kept",
    "epoch_abandoned": "epoch {epoch} is abandoned: {reason}",
    "epoch_step": "epoch {epoch}: {step}",
    "pe_refused": "{pe} refuses epoch {epoch}: {reason}",
    "script_taken": "the script is taken: {reason}",
    "script_refused": "the script is refused: {reason}",
    "script_ended": "the script is held no longer: {reason}",
    "journal_failed": "the journal cannot be written: {problem}",
    "journal_kept": "the journal is written again",
    "standing_by": "this manager stands by: manager {node} is active, term {term}",
    "stepped_down": "this manager steps down: manager {node} is active, term {term}",
    "refused": "most PEs hear no manager although this one sends: it begins a new term",
    "hears_nobody": "this manager hears no node any more and stops sending",
    "taken_over": "the standby takes over, term {term}",
    "stopped": "the manager ends: {reason}",
}


def deed_line(seconds: float, text: str) -> str:
    """Return the line of the trace for an action of the scenario.

    seconds: time of the flight; text: the action's line in the scenario file, without the time
    """
    return f"--- at {seconds:g}s {text}"


def event_line(event: Mapping[str, Any]) -> str | None:
    """Return the line of the trace for an event of the manager; None if the event is no decision."""
    kind = event["event"]
    if kind == "reconfigured":
        changes = [f"{sign}{', '.join(event[what])}" for sign, what in _CHANGES if event[what]]
        return f"epoch {event['epoch']} runs: {'; '.join(changes) or 'the same modules, wired anew'}"
    if kind == "epoch_prepared" and event["contingency"]:
        return f"epoch {event['epoch']} is contingency {event['contingency']}, called by its number"
    template = _LINES.get(kind)
    return None if template is None else template.format_map(event)


_CHANGES = (("start ", "started"), ("stop ", "stopped"), ("move ", "moved"))


def golden_file(file: Path) -> Path:
    """Return the path of a scenario file's golden trace."""
    return file.with_name(f"{file.name}.golden")


def kept(file: Path) -> list[str] | None:
    """Return the lines of a scenario's golden trace; None if the scenario has no golden trace.

    Raises UserError if the golden trace is not text.
    """
    golden = golden_file(file)
    if not golden.exists():
        return None
    try:
        return golden.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise UserError(f"{golden}: the file is not text in UTF-8; --rewrite replaces it") from None


def differences(file: Path, trace: Iterable[str]) -> tuple[str, ...] | None:
    """Return the lines of a diff from a scenario's golden trace to `trace`; empty if the two are equal.

    None: there is no golden trace. Raises UserError if the golden trace is not text.
    """
    before = kept(file)
    if before is None:
        return None
    name = golden_file(file).name
    return tuple(difflib.unified_diff(before, list(trace), name, "this flight", n=1, lineterm=""))


def keep(file: Path, trace: Iterable[str]) -> None:
    """Write a trace as the golden trace of a scenario file."""
    golden_file(file).write_text("".join(f"{line}\n" for line in trace), encoding="utf-8")
