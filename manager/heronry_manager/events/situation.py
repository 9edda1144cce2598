"""Events about the situation: faults, links, channels, the phase, priorities, and what modules report."""

from dataclasses import dataclass
from typing import Annotated, Literal

from heronry_manager.events.event import Event

Priority = int | Literal["default"]


@dataclass(frozen=True, slots=True)
class ModuleRestarted(Event):
    """A module failed, and its PE built it anew; it does not count as failed."""

    element: str
    by: str
    times: int


@dataclass(frozen=True, slots=True)
class ModuleFailed(Event):
    """Why a module failed, as its PE gives it by SDO: exception, message, place."""

    element: str
    by: str
    text: str
    heard_ns: Annotated[int, "when its PE reported it"]


@dataclass(frozen=True, slots=True)
class FaultReported(Event):
    """A module, an agent or the operator reported a fault; it is latched."""

    element: str
    by: str
    detail: Annotated[int, "its meaning depends on the code"]
    code: str


@dataclass(frozen=True, slots=True)
class FaultCleared(Event):
    """The element no longer counts as failed."""

    element: str
    by: str


@dataclass(frozen=True, slots=True)
class LinkLimited(Event):
    """Plans use this share of a radio's bandwidth from now on, as its gateway reports."""

    bus: str
    by: str
    share: Annotated[str, "a percentage"]


@dataclass(frozen=True, slots=True)
class LinkGone(Event):
    """The gateway hears nothing from beyond the radio; all PEs there are lost."""

    bus: str
    by: str


@dataclass(frozen=True, slots=True)
class LinkBack(Event):
    """The gateway hears a PE beyond the radio again."""

    bus: str
    by: str


@dataclass(frozen=True, slots=True)
class ChannelLost(Event):
    """A channel of a replicated bus carries nothing for this node; the other channel does."""

    channel: str
    by: str


@dataclass(frozen=True, slots=True)
class ChannelBack(Event):
    """The channel carries frames for this node again."""

    channel: str
    by: str


@dataclass(frozen=True, slots=True)
class PhaseChanged(Event):
    """The operator, a module or a phase's rule has changed the mission phase."""

    phase: str
    before: str | None
    by: str


@dataclass(frozen=True, slots=True)
class Suspicion(Event):
    """A module reports a PE or a bus as faulty."""

    element: str
    by: str
    evidence: Annotated[str, "what the manager observes"]


@dataclass(frozen=True, slots=True)
class SuspicionAssessed(Event):
    """What the manager found out about a suspected PE or bus."""

    element: str
    found: str


@dataclass(frozen=True, slots=True)
class UnknownElement(Event):
    """The module has reported an element that the spec does not have."""

    module: str
    by: str
    detail: int


@dataclass(frozen=True, slots=True)
class UnknownOutput(Event):
    """A step gives no value for an output, but one under a similar name (misspelt)."""

    module: str
    by: str


@dataclass(frozen=True, slots=True)
class UnknownInput(Event):
    """The module reads an input under a misspelt name, which it can never get."""

    module: str
    by: str


@dataclass(frozen=True, slots=True)
class StateRestored(Event):
    """The module has started from its checkpoint."""

    module: str
    by: Annotated[str, "the PE of the module"]
    age_ms: Annotated[int, "age of the state, at most"]


@dataclass(frozen=True, slots=True)
class StateLacking(Event):
    """The module has a checkpoint in the spec, but has started without a state."""

    module: str
    by: Annotated[str, "the PE of the module"]
    why: str


@dataclass(frozen=True, slots=True)
class StateNotSaved(Event):
    """The state of the module cannot be saved; the module runs on."""

    module: str
    by: Annotated[str, "the PE of the module"]
    why: str


@dataclass(frozen=True, slots=True)
class StateSaved(Event):
    """The state of the module can be saved again, or the module does not run there any more."""

    module: str
    by: Annotated[str, "the PE of the module"]


@dataclass(frozen=True, slots=True)
class InputSilent(Event):
    """A wired input of a running module has had no datum for five periods, at least T_lease."""

    module: str
    by: Annotated[str, "the PE of the module"]
    variable: str
    producer: Annotated[str, "the module that should give it"]


@dataclass(frozen=True, slots=True)
class OutputSilent(Event):
    """A running module has left out an output for five periods, at least T_lease, although its inputs are there."""

    module: str
    by: Annotated[str, "the PE of the module"]
    variable: str


@dataclass(frozen=True, slots=True)
class SilenceOver(Event):
    """Data come again, or the input or output is no longer part of what runs."""

    module: str
    by: str
    variable: str
    what: Literal["input", "output"]
    why: Literal["data come again", "no longer reported", "no longer part of what runs"]
    for_ns: Annotated[int, "since it was reported"]


@dataclass(frozen=True, slots=True)
class Disagreement(Event):
    """Two inputs of this module differ, and neither is known to be wrong."""

    module: str
    by: str
    detail: int


@dataclass(frozen=True, slots=True)
class Agreement(Event):
    """The inputs of this module agree again."""

    module: str
    by: str


@dataclass(frozen=True, slots=True)
class PriorityChanged(Event):
    """The operator or a module has set the priority of the function."""

    function: str
    priority: Annotated[Priority, "'default': the spec's"]
    before: Priority
    by: str


@dataclass(frozen=True, slots=True)
class PriorityRefused(Event):
    """A module has requested a priority that it may not set."""

    function: str
    priority: Annotated[Priority, "'default': the spec's"]
    by: str
    why: str
