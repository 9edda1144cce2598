"""The decision trace of a flight: the scenario's actions and the manager's decisions, one line each, to be compared.

The trace has no times of decisions and no plans. So it changes when a decision changes, and not when a frame gets a
byte longer. (Expectations verify that decisions come in time.) Events `pe_suspected` are left out, since most suspected
PEs answer.

The golden trace of FILE.scenario is FILE.scenario.golden beside it.
"""

import difflib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from heronry_manager import events
from heronry_manager.events.by_kind import on
from heronry_tools.console.errors import UserError

_LINES: Mapping[type[events.Event], Callable[[Any], str]] = dict(
    [
        on(events.ManagerStarted, lambda e: f"manager {e.node} starts, term {e.term}"),
        on(events.SecondManager, lambda e: f"manager {e.node} is active too, term {e.term}"),
        on(events.PeLost, lambda e: f"{e.pe} is lost: {e.cause}"),
        on(events.PeAbsent, lambda e: f"{e.pe} is absent: {e.cause}"),
        on(events.PeHeardAgain, lambda e: f"{e.pe} is heard again: {e.cause}"),
        on(events.PeJoined, lambda e: f"{e.pe} joins: {e.cause}"),
        on(events.TableBrought, lambda e: f"{e.pe} is brought its table"),
        on(events.TableNotTaken, lambda e: f"{e.pe} takes no table: {e.why}"),
        on(events.ModuleRestarted, lambda e: f"{e.element} failed and is restarted on {e.by} ({e.times})"),
        on(events.FaultReported, lambda e: f"{e.element} has failed, reported by {e.by}"),
        on(events.FaultCleared, lambda e: f"{e.element} is cleared by {e.by}"),
        on(events.LinkLimited, lambda e: f"{e.bus} has {e.share} of its bandwidth, reported by {e.by}"),
        on(events.LinkGone, lambda e: f"{e.bus} is gone, reported by {e.by}"),
        on(events.LinkBack, lambda e: f"{e.bus} is back, reported by {e.by}"),
        on(events.ChannelLost, lambda e: f"channel {e.channel} carries nothing, reported by {e.by}"),
        on(events.ChannelBack, lambda e: f"channel {e.channel} is back, reported by {e.by}"),
        on(events.PhaseChanged, lambda e: f"phase {e.phase}, requested by {e.by}"),
        on(events.Suspicion, lambda e: f"{e.element} is suspected by a module on {e.by}: {e.evidence}"),
        on(events.SuspicionAssessed, lambda e: f"{e.element} was suspected: {e.found}"),
        on(
            events.UnknownElement,
            lambda e: f"module:{e.module} on {e.by} reports an element that the spec does not have",
        ),
        on(
            events.UnknownOutput,
            lambda e: f"module:{e.module} on {e.by} gives a misspelt output: the log of its agent names it",
        ),
        on(
            events.UnknownInput,
            lambda e: f"module:{e.module} on {e.by} reads a misspelt input: the log of its agent names it",
        ),
        on(
            events.StateRestored,
            lambda e: f"module:{e.module} on {e.by} starts from a state of {e.age_ms} ms",
        ),
        on(events.StateLacking, lambda e: f"module:{e.module} on {e.by} starts without its state: {e.why}"),
        on(events.StateNotSaved, lambda e: f"the state of module:{e.module} on {e.by} cannot be saved: {e.why}"),
        on(
            events.StateSaved,
            lambda e: f"the state of module:{e.module} on {e.by} is no longer unsaved",
        ),
        on(events.InputSilent, lambda e: f"module:{e.module} on {e.by} gets no {e.variable} from {e.producer}"),
        on(events.OutputSilent, lambda e: f"module:{e.module} on {e.by} gives no {e.variable}"),
        on(events.SilenceOver, lambda e: f"the {e.what} {e.variable} of module:{e.module} on {e.by}: {e.why}"),
        on(events.Disagreement, lambda e: f"two inputs of module:{e.module} disagree, reported by {e.by}"),
        on(events.Agreement, lambda e: f"the inputs of module:{e.module} agree again"),
        on(events.PriorityChanged, lambda e: f"priority {e.priority} of {e.function}, requested by {e.by}"),
        on(
            events.PriorityRefused,
            lambda e: f"priority {e.priority} of {e.function}, requested by {e.by}, is refused: {e.why}",
        ),
        on(events.Adopted, lambda e: f"epoch {e.epoch} is adopted as it runs"),
        on(events.PlanFailed, lambda e: f"no plan: {e.reason}"),
        on(events.PlanUnchanged, lambda _: "everything runs as planned"),
        on(events.PlanKept, lambda _: "the running configuration is kept"),
        on(events.EpochAbandoned, lambda e: f"epoch {e.epoch} is abandoned: {e.reason}"),
        on(events.EpochStep, lambda e: f"epoch {e.epoch}: {e.step}"),
        on(events.PeRefused, lambda e: f"{e.pe} refuses epoch {e.epoch}: {e.reason}"),
        on(events.ScriptTaken, lambda e: f"the script is taken: {e.reason}"),
        on(events.ScriptRefused, lambda e: f"the script is refused: {e.reason}"),
        on(events.ScriptEnded, lambda e: f"the script is held no longer: {e.reason}"),
        on(events.JournalFailed, lambda e: f"the journal cannot be written: {e.problem}"),
        on(events.JournalKept, lambda _: "the journal is written again"),
        on(events.StandingBy, lambda e: f"this manager stands by: manager {e.node} is active, term {e.term}"),
        on(events.SteppedDown, lambda e: f"this manager steps down: manager {e.node} is active, term {e.term}"),
        on(events.Refused, lambda _: "most PEs hear no manager although this one sends: it begins a new term"),
        on(events.HearsNobody, lambda _: "this manager hears no node any more and stops sending"),
        on(events.TakenOver, lambda e: f"the standby takes over, term {e.term}"),
        on(events.Stopped, lambda e: f"the manager ends: {e.reason}"),
    ]
)


def deed_line(seconds: float, text: str) -> str:
    """Return the line of the trace for an action of the scenario.

    seconds: time of the flight; text: the action's line in the scenario file, without the time
    """
    return f"--- at {seconds:g}s {text}"


def event_line(event: events.Event) -> str | None:
    """Return the line of the trace for an event of the manager; None if the event is no decision."""
    match event:
        case events.Reconfigured(epoch=epoch):
            named = (("start", event.started), ("stop", event.stopped), ("move", event.moved))
            changes = [f"{verb} {', '.join(modules)}" for verb, modules in named if modules]
            return f"epoch {epoch} runs: {'; '.join(changes) or 'the same modules, wired anew'}"
        case events.EpochPrepared(epoch=epoch, contingency=number) if number:
            return f"epoch {epoch} is contingency {number}, called by its number"
        case _:
            line = _LINES.get(type(event))
            return None if line is None else line(event)


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
