"""The events and actions of the manager's core, in addition to frames and time (`heronry_wire.sansio`).

Every RequestPlan is answered by one PlanReady or PlanFailed that repeats its number. By this number the core recognises
and drops an answer to an older request.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.memory import Record
from heronry_manager.events import Event
from heronry_wire.frame import Frame
from heronry_wire.management import ManagementMessage
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.standstill import StoodStill


@dataclass(frozen=True, slots=True)
class RequestPlan:
    """The core requests a plan; the driver answers with PlanReady or PlanFailed, which repeat the number `request`.

    running: the running configuration; None: it is not known.
    in_background: the optimal plan is wanted, however long it takes; otherwise a legal plan is wanted immediately.
    target: the configuration that a script of the operator makes (`held_script`). The best plan is compared with it,
        and no contingency is given as the answer. None: there is no script.
    """

    request: int
    now: Situation
    running: Placement | None
    in_background: bool = False
    target: Configuration | None = None


@dataclass(frozen=True, slots=True)
class PlanReady:
    """The answer to RequestPlan of the same number: a plan that the verifier has accepted."""

    request: int
    plan: Plan


@dataclass(frozen=True, slots=True)
class PlanFailed:
    """The answer to RequestPlan of the same number: the planner found no plan; `reason` says why."""

    request: int
    reason: str


@dataclass(frozen=True, slots=True)
class Settled:
    """The plan for situation `now` runs, and nothing is under way: there is time to pre-plan. No answer is needed."""

    now: Situation
    running: Placement


@dataclass(frozen=True, slots=True)
class Emit:
    """Instruction to the driver: write an event to the stream."""

    event: Event


@dataclass(frozen=True, slots=True)
class Keep:
    """Instruction to the driver: write a record to the journal.

    A record with a number (`memory.is_number`) must be on disk before any later frame is sent.
    """

    record: Record


@dataclass(frozen=True, slots=True)
class JournalTold:
    """The journal cannot write records, and `problem` says why; None: it can write again."""

    problem: str | None


@dataclass(frozen=True, slots=True)
class ChannelsLost:
    """Event: the channels of the manager's bus that are lost now, numbered from 1.

    A channel is lost if frames are missing on it that another channel has carried. The driver gives the event at every
    change.
    """

    channels: frozenset[int]


@dataclass(frozen=True, slots=True)
class AliveLeft:
    """An ALIVE frame that the core has sent is now on the bus."""

    frame: Frame


@dataclass(frozen=True, slots=True)
class Stop:
    """Instruction to the driver: end the manager; `reason` is a sentence for the user."""

    reason: str


@dataclass(frozen=True, slots=True)
class AskTraceback:
    """The operator requests the traceback of a module's last failure (`module:NAME`); the answer may take seconds."""

    element: str


@dataclass(frozen=True, slots=True)
class EnterPhase:
    """The operator orders this mission phase."""

    phase: str


@dataclass(frozen=True, slots=True)
class SetPriority:
    """The operator orders a priority of a function; None: that of the spec."""

    function: str
    priority: int | None


@dataclass(frozen=True, slots=True)
class FailElement:
    """The operator reports that an element (`KIND:NAME`) has failed: plans must not use it."""

    element: str


@dataclass(frozen=True, slots=True)
class ClearElement:
    """The operator clears an element: it no longer counts as failed, and a PE leaves its quarantine."""

    element: str


@dataclass(frozen=True, slots=True)
class RetireElement:
    """The operator takes an element out of service: what runs there moves first."""

    element: str


@dataclass(frozen=True, slots=True)
class RestoreElement:
    """The operator takes an element back into service."""

    element: str


@dataclass(frozen=True, slots=True)
class UnlockPe:
    """The operator unlocks a PE (`pe:NAME`) for a while, for the NMT commands and SDO writes of other tools."""

    element: str


@dataclass(frozen=True, slots=True)
class FlyTarget:
    """The operator orders the configuration into which a script turns the running configuration.

    target: the ordered configuration; None: the script leads to no configuration, because of `problem`.
    """

    target: Configuration | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class ReleaseTarget:
    """The operator ends the script that is held, or that was ordered and is not held yet."""


@dataclass(frozen=True, slots=True)
class ReloadSpec:
    """The operator orders that the aircraft flies by another spec, without a landing (`reloading`).

    name, digest: of the other spec. tables: by PE of both specs, its table as it goes over the bus. leaves: PEs that
    the other spec does not have. passes: whether an identifier passes to another module.
    """

    name: str
    digest: str
    tables: Mapping[str, bytes]
    leaves: frozenset[str] = frozenset()
    passes: bool = False


@dataclass(frozen=True, slots=True)
class RequestSwitch:
    """The core requests the first configuration of the other spec; the driver answers with SwitchReady.

    now: the situation, in the words of the present spec. running: what runs.
    """

    number: int
    now: Situation
    running: Placement


@dataclass(frozen=True, slots=True)
class SwitchReady:
    """The answer to the RequestSwitch of the same number: a legal plan of the other spec, compiled (`tables`).

    plan: None: there is none, because of `problem`. digest, slices, slice_digests: of the compiled configuration.
    """

    number: int
    plan: Plan | None = None
    digest: int = 0
    slices: Mapping[int, bytes] = field(default_factory=dict)
    slice_digests: Mapping[int, int] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True, slots=True)
class SpecAtHand:
    """The driver has another spec ready, with this digest: if it flies, this manager can follow (`SpecFollowed`)."""

    digest: str


@dataclass(frozen=True, slots=True)
class SpecFollowed:
    """This manager stands by, and the spec at hand flies: the driver ends this core, and begins one of that spec.

    preparation: how the active manager has prepared its last epoch, for `ManagerCore.catch_up`.
    """

    preparation: tuple[ManagementMessage, ...]


@dataclass(frozen=True, slots=True)
class SpecSwitched:
    """All PEs fly by the other spec: the driver ends this core, and begins one of that spec (`ManagerCore.memory`).

    epoch, digest: what they run.
    """

    epoch: int
    digest: int


@dataclass(frozen=True, slots=True)
class AskStatus:
    """The operator requests the status."""


OrderToExecute = (
    EnterPhase
    | SetPriority
    | FailElement
    | ClearElement
    | RetireElement
    | RestoreElement
    | UnlockPe
    | FlyTarget
    | ReleaseTarget
)
Order = OrderToExecute | ReloadSpec | AskStatus | AskTraceback


@dataclass(frozen=True, slots=True)
class OperatorSaid:
    """An order of the operator, and the `number` by which its Reply is recognized.

    The Reply to AskTraceback comes in a later call of the core; every other order is answered in the same call.
    """

    number: int
    order: Order


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to an order of the operator.

    done: False: the order was refused.
    sentence: what was done, or why not.
    status: the status document, in the answer to AskStatus.
    is_unusable: the order names what the spec does not have, so no manager of this spec could ever carry it out.
    """

    number: int
    done: bool
    sentence: str
    status: Mapping[str, Any] | None = None
    is_unusable: bool = False


DriverEvent = JournalTold | ChannelsLost | AliveLeft | SpecAtHand | StoodStill
ManagerEvent = Received | Tick | PlanReady | PlanFailed | SwitchReady | OperatorSaid | DriverEvent
ManagerAction = Send | RequestPlan | RequestSwitch | SpecSwitched | SpecFollowed | Settled | Emit | Keep | Reply | Stop
