"""The events and actions of the agent core, beside frames and time (`heronry_wire.sansio`).

The answer to a StepModule is one `Stepped`, `StepFailed` or `NotReady`, or the `PartitionEnded` of its partition, or
none. The answer repeats the `release` of the StepModule, a number that is used once, so the core recognizes and drops
an answer that comes after the module was stopped. StartModule is answered only if it failed; MeasureStep by
`StepMeasured`; Drive by `Driven` if the device moved, or `DriveFailed` if it could not. No other action has an answer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from heronry_agent.module import Datum, Value
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import NEVER_NS, Received, Send, StandBack, Tick, Withdraw
from heronry_wire.standstill import StoodStill


class Stepped(NamedTuple):
    """A module has computed one period.

    outputs: value by variable; a variable left out is not published.
    writes: commands of the module to its device, in order; none has been executed yet.
    reports: (element, detail) of each element that the module reports failed, as `device:NAME` or `module:NAME`.
    phases: mission phases that the module requested, in their order.
    priorities: (function, priority) of each priority that the module requested; SPECS_PRIORITY: that of the spec.
    spent_ns: duration of the step, without the time in which it waited for a processor.
    """

    module: int
    release: int
    outputs: Mapping[str, Value]
    writes: tuple[Value, ...] = ()
    reports: tuple[tuple[str, int], ...] = ()
    phases: tuple[str, ...] = ()
    spent_ns: int = 0
    priorities: tuple[tuple[str, int], ...] = ()


class Failure(NamedTuple):
    """How the code of a module has failed: `reason` is one line; `traceback` is empty if no exception was raised."""

    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class StepFailed:
    """A module raised an exception in its step; the texts are those of a `Failure`."""

    module: int
    release: int
    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class StartFailed:
    """A module could not be built; the texts are those of a `Failure`."""

    module: int
    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class NotReady:
    """A step was not computed, since the partition was still loading; now the partition has loaded."""

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
    """A partition and all its modules have ended; `computing` is the module whose step was under way, if any."""

    partition: str
    reason: str
    computing: int | None = None


@dataclass(frozen=True, slots=True)
class ImagesMissing:
    """The images that cannot be loaded on this PE, each with the reason in one line."""

    images: Mapping[str, str]


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
    """Let a module run in a mode (an index into `entry.modes`); a kept module goes on with its state, if it can."""

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

    inputs: (variable, datum) by leaf path; only fresh data.
    until_ns: when the module's output authorization ends, unless a later step extends it.
    """

    module: int
    release: int
    inputs: Mapping[str, tuple[str, Datum]]
    until_ns: int = NEVER_NS


@dataclass(frozen=True, slots=True)
class MeasureStep:
    """Measure the time that a step has spent, because it should have ended by now."""

    module: int
    release: int


@dataclass(frozen=True, slots=True)
class EndPartition:
    """End a partition by force, with all modules in it."""

    partition: str


@dataclass(frozen=True, slots=True)
class Drive:
    """Command the device of a module to a value."""

    module: int
    value: Value


@dataclass(frozen=True, slots=True)
class Heard:
    """Hand the plant the value of another PE's actuator, from an output echo of that PE."""

    device: str
    value: float


@dataclass(frozen=True, slots=True)
class Note:
    """A line for the log; `kind` is a word to filter by."""

    kind: str
    text: str


class Left(NamedTuple):
    """A frame has left the controller of a port, `took_ns` after it was handed over.

    0: the driver does not know the time.
    """

    port: int
    took_ns: int


class ChannelsLost(NamedTuple):
    """The lost channels of a port's bus, numbered from 1; sent when they change."""

    port: int
    channels: frozenset[int]


ModuleEvent = (
    Stepped | StepFailed | StartFailed | NotReady | StepMeasured | PartitionEnded | ImagesMissing | Driven | DriveFailed
)
Event = Received | Tick | Left | ChannelsLost | StoodStill | ModuleEvent
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
