"""What the manager's core is told and what it asks for, beside frames and time (`heronry_wire.sansio`).

Every RequestPlan is answered by one PlanReady or PlanFailed that repeats its number: an answer to an older question is
thereby recognised and dropped.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.memory import Record
from heronry_wire.frame import Frame
from heronry_wire.sansio import Received, Send, Tick


@dataclass(frozen=True, slots=True)
class RequestPlan:
    """Ask for a plan; answer with PlanReady or PlanFailed and the same number.

    running: what runs now; None: nothing is known to run.
    at_leisure: for the best plan, however long it takes. Else it must come at once, and need not be the best.
    """

    request: int
    now: Situation
    running: Placement | None
    in_background: bool = False


@dataclass(frozen=True, slots=True)
class PlanReady:
    """The answer to RequestPlan: a plan that the judge has accepted."""

    request: int
    plan: Plan


@dataclass(frozen=True, slots=True)
class PlanFailed:
    """The planner could not answer."""

    request: int
    reason: str


@dataclass(frozen=True, slots=True)
class Settled:
    """What was planned for this runs, and nothing is under way: time to think ahead. Needs no answer."""

    now: Situation
    running: Placement


@dataclass(frozen=True, slots=True)
class Emit:
    """An event for the stream."""

    event: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Keep:
    """Keep this over a restart; what may never be used twice, before anything that comes after it is sent."""

    record: Record


@dataclass(frozen=True, slots=True)
class JournalTold:
    """Whether the journal can keep what it is given: what is wrong, or None where it can again."""

    problem: str | None


@dataclass(frozen=True, slots=True)
class ChannelsLost:
    """Which channels of the manager's bus, from 1, carry nothing of what the other one carries; told on change."""

    channels: frozenset[int]


@dataclass(frozen=True, slots=True)
class AliveLeft:
    """An ALIVE that was asked for is on the bus."""

    frame: Frame


@dataclass(frozen=True, slots=True)
class Stop:
    """The manager must end; `reason` is a sentence for the user."""

    reason: str


@dataclass(frozen=True, slots=True)
class EnterPhase:
    """The operator wants this mission phase."""

    phase: str


@dataclass(frozen=True, slots=True)
class FailElement:
    """The operator says that an element (`KIND:NAME`) has failed: plan without it."""

    element: str


@dataclass(frozen=True, slots=True)
class ClearElement:
    """The operator says that an element is well again; for a PE, that its quarantine is over."""

    element: str


@dataclass(frozen=True, slots=True)
class UnlockPe:
    """The operator wants other tools to write on a PE (`pe:NAME`) for a while, by NMT and SDO."""

    element: str


@dataclass(frozen=True, slots=True)
class AskStatus:
    """The operator wants to know how things stand."""


Order = EnterPhase | FailElement | ClearElement | UnlockPe | AskStatus


@dataclass(frozen=True, slots=True)
class OperatorSaid:
    """An order; answered at once by one Reply with the same number."""

    number: int
    order: Order


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to an order: what was done, or why not, in a sentence; for AskStatus the status."""

    number: int
    done: bool
    sentence: str
    status: Mapping[str, Any] | None = None


ManagerEvent = Received | Tick | PlanReady | PlanFailed | OperatorSaid | JournalTold | ChannelsLost | AliveLeft
ManagerAction = Send | RequestPlan | Settled | Emit | Keep | Reply | Stop
