"""The sentences of events that need nothing but the event itself, each with a tone, which selects its colour."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from heronry_manager import events

_E = TypeVar("_E", bound=events.Event)
Tone = Literal["plain", "good", "bad", "fault", "quiet", "title"]


@dataclass(frozen=True, slots=True)
class Line:
    """One sentence of the story."""

    text: str
    tone: Tone = "plain"


def plain_line(event: events.Event) -> Line | None:
    """Return the sentence of an event; None if there is none, or if the sentence would depend on other events."""
    if type(event) not in _SENTENCES:
        return None
    sentence, tone = _SENTENCES[type(event)]
    return Line(sentence(event), tone)


_Sentence = tuple[Callable[[Any], str], Tone]


def _says(kind: type[_E], sentence: Callable[[_E], str], tone: Tone) -> tuple[type[events.Event], _Sentence]:
    return kind, (sentence, tone)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "its modules"


_SENTENCES = dict(
    [
        _says(events.Bus, lambda e: e.models, "quiet"),
        _says(events.Page, lambda e: f"watch it in a browser: {e.address}", "title"),
        _says(events.Orders, lambda e: f"beside this demo, in another terminal: heronry status {e.flags}", "quiet"),
        _says(events.PlannedAhead, lambda e: e.sentence, "quiet"),
        _says(
            events.ManagerStarted, lambda e: f"manager {e.node} on {e.bus}, term {e.term}; waiting for the PEs", "quiet"
        ),
        _says(events.BusTrouble, lambda e: e.sentence, "bad"),
        _says(
            events.CommandsRefused,
            lambda e: f"{e.pe} has refused commands: {e.unproven} with a wrong tag, and {e.other} others",
            "bad",
        ),
        _says(
            events.StatesUnproven,
            lambda e: f"{e.pe} is heard, but without a valid proof: it has another key or none, or cannot receive",
            "bad",
        ),
        _says(
            events.StatesDoubted,
            lambda e: f"another node sends as {e.pe}: {e.refused} of its states were refused",
            "bad",
        ),
        _says(
            events.Attacked,
            lambda e: f"ATTACK on {e.bus}: forged frames take {e.percent} % of it, {e.frames_per_s} in a second",
            "bad",
        ),
        _says(events.OutputsHeld, lambda e: f"{e.pe} holds back what {_listed(e.modules)} drive: {e.cause}", "bad"),
        _says(events.OutputsFree, lambda e: f"{e.pe} drives its exclusive outputs again", "good"),
        _says(events.PeAbsent, lambda e: f"{e.pe} is absent: {e.cause}", "fault"),
        _says(events.PeHeardAgain, lambda e: f"{e.pe} is heard again; {e.cause}", "plain"),
        _says(
            events.ModuleRestarted, lambda e: f"{e.element} failed and is started again on {e.by} ({e.times})", "fault"
        ),
        _says(events.ModuleFailed, lambda e: f"why {e.element} failed on {e.by}: {e.text}", "bad"),
        _says(events.FaultReported, lambda e: f"{e.element} has failed, reported by {e.by}", "fault"),
        _says(
            events.LinkLimited,
            lambda e: f"the link {e.bus} has {e.share} of its bandwidth, reported by {e.by}",
            "fault",
        ),
        _says(events.LinkGone, lambda e: f"the link {e.bus} is gone, reported by {e.by}", "fault"),
        _says(events.LinkBack, lambda e: f"the link {e.bus} is back, reported by {e.by}", "plain"),
        _says(
            events.ChannelLost,
            lambda e: f"channel {e.channel} carries nothing, reported by {e.by}; the bus works on the other channel",
            "fault",
        ),
        _says(events.ChannelBack, lambda e: f"channel {e.channel} is back, reported by {e.by}", "plain"),
        _says(events.PlanFailed, lambda e: f"no plan: {e.reason}; the configuration stays as it is", "bad"),
        _says(events.PeRefused, lambda e: f"{e.pe} cannot stage epoch {e.epoch}: {e.reason}", "bad"),
        _says(events.AnotherTable, lambda e: f"{e.pe} stages nothing: {e.why}", "bad"),
        _says(
            events.TableBrought,
            lambda e: f"{e.pe} waited without a table, and was brought it: {e.bytes} bytes in {e.took_ns / 1e9:.1f} s",
            "good",
        ),
        _says(events.UnknownNode, lambda e: f"node {e.node} is not in the spec: it {e.says}", "bad"),
        _says(events.TableNotTaken, lambda e: f"{e.pe} waits without a table: {e.why}; the table is sent again", "bad"),
        _says(
            events.CodeBrought,
            lambda e: f"{e.pe} lacked code, and has {e.bundle} {e.version}: {e.bytes} bytes in {e.took_ns / 1e9:.1f} s",
            "good",
        ),
        _says(events.CodeNotTaken, lambda e: f"{e.pe} lacks code: {e.why}", "bad"),
        _says(events.SecondManager, lambda e: f"manager {e.node} is active, too", "bad"),
        _says(events.FaultCleared, lambda e: f"{e.element} counts as working again, cleared by {e.by}", "good"),
        _says(events.Suspicion, lambda e: f"{e.element} is suspected by a module on {e.by}: {e.evidence}", "quiet"),
        _says(events.SuspicionAssessed, lambda e: f"{e.element} was suspected: {e.found}", "quiet"),
        _says(
            events.UnknownElement,
            lambda e: f"module:{e.module} on {e.by} reports an element that the spec does not have",
            "bad",
        ),
        _says(
            events.UnknownOutput,
            lambda e: f"module:{e.module} on {e.by} gives a misspelt output: the log of its agent names it",
            "bad",
        ),
        _says(
            events.UnknownInput,
            lambda e: f"module:{e.module} on {e.by} reads a misspelt input: the log of its agent names it",
            "bad",
        ),
        _says(
            events.StateRestored,
            lambda e: f"module:{e.module} on {e.by} starts from a state of {e.age_ms} ms",
            "good",
        ),
        _says(events.StateLacking, lambda e: f"module:{e.module} on {e.by} starts without its state: {e.why}", "quiet"),
        _says(
            events.StateNotSaved, lambda e: f"the state of module:{e.module} on {e.by} cannot be saved: {e.why}", "bad"
        ),
        _says(
            events.StateSaved,
            lambda e: f"the state of module:{e.module} on {e.by} is no longer unsaved",
            "good",
        ),
        _says(
            events.InputSilent, lambda e: f"module:{e.module} on {e.by} gets no {e.variable} from {e.producer}", "fault"
        ),
        _says(
            events.OutputSilent,
            lambda e: f"module:{e.module} on {e.by} gives no {e.variable}, although its inputs are there",
            "fault",
        ),
        _says(
            events.SilenceOver,
            lambda e: f"the {e.what} {e.variable} of module:{e.module} on {e.by} is no longer silent: {e.why}",
            "good",
        ),
        _says(
            events.Disagreement,
            lambda e: f"two inputs of module:{e.module} disagree (detail {e.detail}), reported by {e.by}",
            "bad",
        ),
        _says(events.Agreement, lambda e: f"the inputs of module:{e.module} agree again", "good"),
        _says(
            events.PriorityChanged,
            lambda e: f"PRIORITY of {e.function}: {e.priority} (was {e.before}), requested by {e.by}",
            "title",
        ),
        _says(
            events.PriorityRefused,
            lambda e: f"priority {e.priority} of {e.function}, requested by {e.by}, is refused: {e.why}",
            "bad",
        ),
        _says(events.PhaseChanged, lambda e: f"PHASE {e.phase} (was {e.before}), requested by {e.by}", "title"),
        _says(events.ScriptTaken, lambda e: f"the operator's script is deployed: {e.reason}", "title"),
        _says(events.ScriptRefused, lambda e: f"the operator's script changes nothing: {e.reason}", "bad"),
        _says(events.ScriptEnded, lambda e: f"the operator's script is held no longer: {e.reason}", "title"),
        _says(events.JournalFailed, lambda e: f"the journal cannot be written: {e.problem}", "bad"),
        _says(events.JournalKept, lambda _: "the journal is written again", "good"),
        _says(events.StandingBy, lambda e: f"a standby manager follows manager {e.node}, term {e.term}", "quiet"),
        _says(
            events.OtherSpecFlies,
            lambda e: (
                f"another spec flies (digest {e.digest}...) than that of a standby manager, which goes on with it once "
                "it has been given it: heronry reload SPEC --standby"
            ),
            "bad",
        ),
        _says(
            events.Refused, lambda _: "most PEs do not hear the active manager: the manager begins a new term", "bad"
        ),
        _says(
            events.HearsNobody, lambda _: "a manager hears no node any more: it sends nothing until it hears one", "bad"
        ),
        _says(
            events.SteppedDown,
            lambda e: f"a manager gives up its mastership: manager {e.node} is active with the higher term {e.term}",
            "plain",
        ),
        _says(events.Adopted, lambda e: f"epoch {e.epoch} runs already: the manager adopts it as it is", "good"),
        _says(
            events.UnknownEpoch,
            lambda e: f"this manager does not know the running epoch {e.epoch}, and gives no advice",
            "bad",
        ),
    ]
)
