"""The events and actions of the agent core, beside frames and time (`heronry_wire.sansio`).

A StepModule is answered by one `Stepped`, `StepFailed` or `NotReady` that repeats its `release`, a number that is used
once, or by the `PartitionEnded` of its partition, or never: an answer that comes after the module was stopped is
thereby recognised and dropped. StartModule is answered only if it failed, MeasureStep by `StepMeasured`, Drive by
`Driven` if the device moved or `DriveFailed` if it could not. No other action needs an answer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from heronry_agent.module import Datum, Value
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import NEVER_NS, Received, Send, StandBack, Tick, Withdraw


class Stepped(NamedTuple):
    """A module has computed one period.

    outputs: value by variable; one left out is not published.
    writes: commands of the module to its device, in order; none has been executed yet.
    reports: (element, detail): elements that the module says have failed, as `device:NAME` or `module:NAME`.
    phases: mission phases that the module requested, in their order.
    spent_ns: how long the step took, without the time for which the processor was not its own.
    """

    module: int
    release: int
    outputs: Mapping[str, Value]
    writes: tuple[Value, ...] = ()
    reports: tuple[tuple[str, int], ...] = ()
    phases: tuple[str, ...] = ()
    spent_ns: int = 0


@dataclass(frozen=True, slots=True)
class StepFailed:
    """A module raised an exception in its step; `reason` is one line."""

    module: int
    release: int
    reason: str


@dataclass(frozen=True, slots=True)
class StartFailed:
    """A module could not be built; `reason` is one line."""

    module: int
    reason: str


@dataclass(frozen=True, slots=True)
class NotReady:
    """A module could not be stepped, since its partition was still loading; now it can."""

    module: int
    release: int


@dataclass(frozen=True, slots=True)
class StepMeasured:
    """Time in ns that an unfinished step has spent so far, as in `Stepped`."""

    module: int
    release: int
    spent_ns: int


@dataclass(frozen=True, slots=True)
class PartitionEnded:
    """A partition and all its modules have ended, with the one that was `computing`; `reason` is one line."""

    partition: str
    reason: str
    computing: int | None = None


@dataclass(frozen=True, slots=True)
class ImagesMissing:
    """Images that cannot be loaded here."""

    images: frozenset[str]


@dataclass(frozen=True, slots=True)
class Driven:
    """The device of a module has moved, to this value."""

    module: int
    value: Value


@dataclass(frozen=True, slots=True)
class DriveFailed:
    """The device of a module cannot execute a command of the module; `reason` is one line."""

    module: int
    reason: str


@dataclass(frozen=True, slots=True)
class StartModule:
    """Let a module run in a mode (an index into `entry.modes`): a module that was kept goes on, if it can do that."""

    module: int
    entry: ModuleEntry
    mode: int


@dataclass(frozen=True, slots=True)
class StopModule:
    """Stop stepping a module: drop it, or keep it for the StartModule that follows in another mode."""

    module: int
    keep: bool = False


class StepModule(NamedTuple):
    """Let a module compute one period.

    inputs: (variable, datum) by leaf path, fresh ones only.
    until_ns: when its output authorization ends, unless a later step extends it.
    """

    module: int
    release: int
    inputs: Mapping[str, tuple[str, Datum]]
    until_ns: int = NEVER_NS


@dataclass(frozen=True, slots=True)
class MeasureStep:
    """Measure how much time a step has spent that should have ended by now."""

    module: int
    release: int


@dataclass(frozen=True, slots=True)
class EndPartition:
    """End a partition by force, with all modules in it."""

    partition: str


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive the device of a module."""

    module: int
    value: Value


@dataclass(frozen=True, slots=True)
class Heard:
    """An output echo of another PE gives the value of one of its actuators: the plant follows it."""

    device: str
    value: float


@dataclass(frozen=True, slots=True)
class Note:
    """A line for the log; `kind` is a word to filter by."""

    kind: str
    text: str


class Left(NamedTuple):
    """A frame has left the controller of a port, `took_ns` after it was handed over; 0: the driver cannot tell."""

    port: int
    took_ns: int


class ChannelsLost(NamedTuple):
    """Which channels of a port's bus, from 1, carry no frames although the other one does; sent on change."""

    port: int
    channels: frozenset[int]


ModuleEvent = (
    Stepped | StepFailed | StartFailed | NotReady | StepMeasured | PartitionEnded | ImagesMissing | Driven | DriveFailed
)
Event = Received | Tick | Left | ChannelsLost | ModuleEvent
Action = (
    Send
    | Withdraw
    | StandBack
    | StartModule
    | StopModule
    | StepModule
    | MeasureStep
    | EndPartition
    | Drive
    | Heard
    | Note
)
