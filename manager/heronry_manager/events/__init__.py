"""The one stream of events: what the manager saw, decided and did, and what others add to it, as versioned JSON lines.

Every kind of event is a frozen data class with the fields of its line; its docstring says what the event tells, and an
`Annotated` note says more about a field where its name does not say all. All else follows from these classes: the line
(`line`), the reader of lines (`reading`), the JSON schema (`schema`) and the table in docs/events.md. Programs that
write or read events import this package, and no reader looks a field up by a name in quotes.

    from heronry_manager import events

    turn.emit(events.PeLost, pe="nav", cause="silent", last_heard_ns=None)
    match event:
        case events.PeLost(pe=pe): ...

The manager's core and its driver write lines, `heronry demo` adds lines about what it did to the system (kill,
restore), and a feed adds what it sees on the bus. Programs that show the system never query the manager:
`heronry_tools.watch` builds a snapshot for them from the lines, live or recorded.

The files divide the kinds by their subject. The duration of a reconfiguration is always given in four parts: detect,
decide, distribute, activate.
"""

from collections.abc import Mapping
from types import ModuleType

from heronry_manager.events import demo, epochs, feeds, managers, pes, situation
from heronry_manager.events.demo import (
    Heartbeat,
    Logs,
    Orders,
    Outage,
    Outages,
    Overtime,
    Page,
    PlannedAhead,
    Process,
    Summary,
)
from heronry_manager.events.epochs import (
    Adopted,
    Advice,
    AnotherTable,
    CodeBrought,
    CodeNotTaken,
    ControlPaths,
    EpochAbandoned,
    EpochPrepared,
    EpochStep,
    PeRefused,
    PlanFailed,
    PlanKept,
    PlanReady,
    PlanRequested,
    PlanUnchanged,
    Reconfigured,
    ScriptEnded,
    ScriptRefused,
    ScriptTaken,
    TableBrought,
    TableNotTaken,
    Times,
    UnknownEpoch,
    UnknownNode,
)
from heronry_manager.events.event import (
    VERSION,
    Event,
    UnknownEvent,
)
from heronry_manager.events.feeds import (
    BusSeen,
    EpochSeen,
    Feed,
    Heard,
    LinesLost,
    ManagerSeen,
    PeSeen,
    Place,
    Resumed,
    Runs,
    Status,
)
from heronry_manager.events.managers import (
    Bus,
    BusTrouble,
    HearsNobody,
    JournalFailed,
    JournalKept,
    ManagerStarted,
    OtherSpecFlies,
    Refused,
    SecondManager,
    StandingBy,
    SteppedDown,
    Stopped,
    TakenOver,
)
from heronry_manager.events.pes import (
    Attacked,
    CommandsRefused,
    OutputsFree,
    OutputsHeld,
    PeAbsent,
    PeAnswered,
    PeHeardAgain,
    PeJoined,
    PeLost,
    PeSuspected,
    StatesDoubted,
    StatesUnproven,
    StoodStill,
    Waited,
)
from heronry_manager.events.situation import (
    Agreement,
    ChannelBack,
    ChannelLost,
    Disagreement,
    FaultCleared,
    FaultReported,
    InputSilent,
    LinkBack,
    LinkGone,
    LinkLimited,
    ModuleFailed,
    ModuleRestarted,
    OutputSilent,
    PhaseChanged,
    PriorityChanged,
    PriorityRefused,
    SilenceOver,
    StateLacking,
    StateNotSaved,
    StateRestored,
    StateSaved,
    Suspicion,
    SuspicionAssessed,
    UnknownElement,
    UnknownInput,
    UnknownOutput,
)

__all__ = [
    "KINDS",
    "SUBJECTS",
    "VERSION",
    "Adopted",
    "Advice",
    "Agreement",
    "AnotherTable",
    "Attacked",
    "Bus",
    "BusSeen",
    "BusTrouble",
    "ChannelBack",
    "ChannelLost",
    "CodeBrought",
    "CodeNotTaken",
    "CommandsRefused",
    "ControlPaths",
    "Disagreement",
    "EpochAbandoned",
    "EpochPrepared",
    "EpochSeen",
    "EpochStep",
    "Event",
    "FaultCleared",
    "FaultReported",
    "Feed",
    "Heard",
    "HearsNobody",
    "Heartbeat",
    "InputSilent",
    "JournalFailed",
    "JournalKept",
    "LinesLost",
    "LinkBack",
    "LinkGone",
    "LinkLimited",
    "Logs",
    "ManagerSeen",
    "ManagerStarted",
    "ModuleFailed",
    "ModuleRestarted",
    "Orders",
    "OtherSpecFlies",
    "Outage",
    "Outages",
    "OutputSilent",
    "OutputsFree",
    "OutputsHeld",
    "Overtime",
    "Page",
    "PeAbsent",
    "PeAnswered",
    "PeHeardAgain",
    "PeJoined",
    "PeLost",
    "PeRefused",
    "PeSeen",
    "PeSuspected",
    "PhaseChanged",
    "Place",
    "PlanFailed",
    "PlanKept",
    "PlanReady",
    "PlanRequested",
    "PlanUnchanged",
    "PlannedAhead",
    "PriorityChanged",
    "PriorityRefused",
    "Process",
    "Reconfigured",
    "Refused",
    "Resumed",
    "Runs",
    "ScriptEnded",
    "ScriptRefused",
    "ScriptTaken",
    "SecondManager",
    "SilenceOver",
    "StandingBy",
    "StateLacking",
    "StateNotSaved",
    "StateRestored",
    "StateSaved",
    "StatesDoubted",
    "StatesUnproven",
    "Status",
    "SteppedDown",
    "StoodStill",
    "Stopped",
    "Summary",
    "Suspicion",
    "SuspicionAssessed",
    "TableBrought",
    "TableNotTaken",
    "TakenOver",
    "Times",
    "UnknownElement",
    "UnknownEpoch",
    "UnknownEvent",
    "UnknownInput",
    "UnknownNode",
    "UnknownOutput",
    "Waited",
    "kinds_of",
]

SUBJECTS: tuple[ModuleType, ...] = (managers, pes, situation, epochs, demo, feeds)


def kinds_of(subject: ModuleType) -> list[type[Event]]:
    """Return the kinds of events that a file declares, in its order."""
    own = (one for one in vars(subject).values() if isinstance(one, type) and one.__module__ == subject.__name__)
    return [one for one in own if issubclass(one, Event)]


KINDS: Mapping[str, type[Event]] = {one.KIND: one for subject in SUBJECTS for one in kinds_of(subject)}
