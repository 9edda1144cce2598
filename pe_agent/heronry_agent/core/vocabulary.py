"""The events and actions of the agent core, except those for frames and time (`heronry_wire.sansio`).

The driver answers seven of the actions; no other action has an answer:

    StepModule    `Stepped`, `StepFailed` or `NotReady`, or the `PartitionEnded` of the module's partition
    StartModule   `StartFailed` if the start has failed. A start that succeeds has no answer, unless the order has
                  `kept`: then `StateRestored` or `StateLacking`, or `StateUnused` if the module was not built
    SaveState     `StateSaved` or `StateLacking`; none if the module does not run
    MeasureStep   `StepMeasured`
    Drive         `Driven` if the device has moved; `DriveFailed` if the device could not execute the command
    StopModule    `AtRest` when the device has taken its safe action, if the core was told that this may take time
    PrepareTable  `TablePrepared`

An answer to StepModule repeats the `release` of the StepModule, a number that is used only once. If the module is
stopped during its step, the answer may be missing, or come late. By the `release` the core recognizes a late answer,
and drops it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from heronry_agent.module import Datum, Value
from heronry_wire.checkpoint_frames import Lack, SentState
from heronry_wire.pe_table import ModuleEntry, PeTable
from heronry_wire.sansio import NEVER_NS, Received, Send, StandBack, Tick, Withdraw
from heronry_wire.standstill import StoodStill


class Stepped(NamedTuple):
    """A module has computed one step.

    outputs: value by variable; a variable left out is not published.
    writes: commands of the module to its device, in order; none has been executed yet.
    reports: (`KIND:NAME`, detail) for each element that the module reports failed; the detail is a number of the
        module's choice. DISAGREEMENT in place of `KIND:NAME` reports that two inputs differ.
    phases: mission phases that the module requested, in order.
    priorities: (function, priority) for each request; the priority SPECS_PRIORITY stands for that of the spec.
    misspelt_inputs: (name, the input that was probably meant) for each input that the module reads under a wrong name.
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
    misspelt_inputs: tuple[tuple[str, str], ...] = ()


class KeptState(NamedTuple):
    """A state of a module from which it may start.

    since_ns: the state was saved at this time or later. until_ns: time after which it is too old.
    """

    state: SentState
    since_ns: int
    until_ns: int


@dataclass(frozen=True, slots=True)
class StateSaved:
    """The state of a module, as SaveState ordered it; `round` repeats that of the order.

    code: digest of the module's code, DIGEST_BYTES bytes. data: empty if the module has no state yet.
    saved_ns: when `save` was called.
    """

    module: int
    round: int
    code: bytes
    data: bytes
    saved_ns: int


@dataclass(frozen=True, slots=True)
class StateRestored:
    """A module has started from its state, which was at most `age_ns` old."""

    module: int
    age_ns: int


@dataclass(frozen=True, slots=True)
class StateLacking:
    """A module has started without its state, or its state cannot be saved; `reason` is one line, or empty."""

    module: int
    lack: Lack
    reason: str = ""


@dataclass(frozen=True, slots=True)
class StateUnused:
    """A module goes on with its present object in another mode, so it needs no state."""

    module: int


class Failure(NamedTuple):
    """A failure of a module's code: `reason` is one line; `traceback` is empty if no exception was raised."""

    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class StepFailed:
    """A step of a module has failed; `reason` is one line; `traceback` is empty if no exception was raised."""

    module: int
    release: int
    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class StartFailed:
    """A module could not be built; `reason` is one line, `traceback` may be empty."""

    module: int
    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class NotReady:
    """A step was not computed because its partition was still loading code; the partition is ready now."""

    module: int
    release: int


@dataclass(frozen=True, slots=True)
class StepMeasured:
    """An unfinished step has spent `spent_ns` so far, without the time in which it waited for a processor."""

    module: int
    release: int
    spent_ns: int


@dataclass(frozen=True, slots=True)
class PartitionEnded:
    """A partition has ended, and its modules with it; `computing` is the module whose step was unfinished, or None."""

    partition: str
    reason: str
    computing: int | None = None


@dataclass(frozen=True, slots=True)
class ImagesMissing:
    """Some images cannot be loaded on this PE; `images` gives the reason for each, in one line."""

    images: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class ImagesArrived:
    """The code of these images was not on this PE, and is here now."""

    images: frozenset[str]


class ProgramState(NamedTuple):
    """What the loader of this PE says of itself.

    version: of the code that runs; 0: there is none.
    error: why its last order failed, as object 1F57h numbers it; 0: it has not failed.
    is_at_work: whether an order is not answered yet.
    digest: SHA-256 of the bundle whose code runs, 32 bytes; empty: there is none.
    """

    version: int = 0
    error: int = 0
    is_at_work: bool = False
    digest: bytes = b""


@dataclass(frozen=True, slots=True)
class ProgramChanged:
    """The loader's state is another one: it has done or refused an order, or has taken back code that failed."""

    state: ProgramState


@dataclass(frozen=True, slots=True)
class WriteProgram:
    """Check a bundle that has come over the bus, and keep it; ProgramChanged answers."""

    content: bytes


@dataclass(frozen=True, slots=True)
class KeepParts:
    """Keep what has come of an unfinished bundle, in place of what was kept before; nothing answers.

    content: all of it as one part from the beginning, encoded (`heronry_wire.part_transfer`).
    """

    content: bytes


@dataclass(frozen=True, slots=True)
class ControlProgram:
    """Start the code that was written last, or else forget it; ProgramChanged answers."""

    is_start: bool


@dataclass(frozen=True, slots=True)
class Driven:
    """The device of a module has executed a command, and has moved to `value`."""

    module: int
    value: Value


@dataclass(frozen=True, slots=True)
class DriveFailed:
    """The device of a module could not execute a command; `reason` is one line."""

    module: int
    reason: str


@dataclass(frozen=True, slots=True)
class AtRest:
    """The device of a stopped module has taken its safe action."""

    module: int


@dataclass(frozen=True, slots=True)
class StartModule:
    """Build a module, or continue a module that StopModule has kept; `mode` is an index into `entry.modes`.

    kept: the state from which a module with a checkpoint starts if it is built, or why there is none. None: the module
    has no checkpoint, or must forget its state.
    """

    module: int
    entry: ModuleEntry
    mode: int
    kept: KeptState | Lack | None = None


@dataclass(frozen=True, slots=True)
class SaveState:
    """Save the state of a module after the step that was ordered last; at most `most_bytes` bytes."""

    module: int
    round: int
    most_bytes: int


@dataclass(frozen=True, slots=True)
class StopModule:
    """Stop stepping a module, and drop it; with `keep`, keep its state for a StartModule in another mode."""

    module: int
    keep: bool = False


class StepModule(NamedTuple):
    """Let a module compute one step.

    release: number of the step, which the answer repeats.
    inputs: (variable, datum) by path of the leaf; only fresh data.
    until_ns: time in ns after which the module must not drive its outputs, unless a later step gives a later time.
    """

    module: int
    release: int
    inputs: Mapping[str, tuple[str, Datum]]
    until_ns: int = NEVER_NS


@dataclass(frozen=True, slots=True)
class MeasureStep:
    """Measure how much time an unfinished step has spent; `StepMeasured` answers."""

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
    """Tell the plant to which `value` another PE has commanded the actuator `device`.

    The output echo of the other PE has shown this value.
    """

    device: str
    value: float


@dataclass(frozen=True, slots=True)
class Note:
    """A line for the log; `kind` is one word, by which lines can be filtered."""

    kind: str
    text: str


class Left(NamedTuple):
    """A frame has left the CAN controller of a port, `took_ns` after it was handed over; 0: the time is unknown."""

    port: int
    took_ns: int


class ChannelsLost(NamedTuple):
    """The set of lost channels of a port's replicated bus has changed; `channels` is the new set, numbered from 1."""

    port: int
    channels: frozenset[int]


StateEvent = StateSaved | StateRestored | StateLacking | StateUnused


@dataclass(frozen=True, slots=True)
class PrepareTable:
    """Another table has come beside the one that flies: read it, open its devices, and begin to load its code.

    `TablePrepared` answers, later, since a text may take long to be read (`read_beside`). A table that flies, or is
    beside already, has no answer. The modules that run go on.

    text: as it came. number: tells the partitions of this table from those of others that came.
    """

    text: bytes
    number: int


@dataclass(frozen=True, slots=True)
class TablePrepared:
    """The driver is prepared for a table, or cannot fly by it.

    table: as `read_beside` has given it; None: it cannot be read.
    missing: images of the table whose code is not on this PE, each with the reason.
    slow_to_rest: modules of the table whose StopModule the driver answers with AtRest.
    problem: why this PE cannot fly by the table, as a part of a sentence; None: it can.
    """

    table: PeTable | None
    missing: Mapping[str, str] = field(default_factory=dict)
    slow_to_rest: frozenset[int] = frozenset()
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class SwitchTable:
    """From now on modules are named by their indices in this table, for which the driver is prepared.

    modules: of the modules that go on, the index so far -> the index from now on. No other module runs.
    """

    table: PeTable
    modules: Mapping[int, int]


ModuleEvent = (  # what the host of modules reports, with what its loader reports
    Stepped
    | StepFailed
    | StartFailed
    | NotReady
    | StepMeasured
    | PartitionEnded
    | ImagesMissing
    | ImagesArrived
    | ProgramChanged
    | Driven
    | DriveFailed
    | AtRest
    | TablePrepared
    | StateEvent
)
Event = Received | Tick | Left | ChannelsLost | StoodStill | ModuleEvent
Action = (
    Send
    | Withdraw
    | StandBack
    | StartModule
    | StopModule
    | StepModule
    | SaveState
    | MeasureStep
    | EndPartition
    | Drive
    | Heard
    | WriteProgram
    | KeepParts
    | ControlProgram
    | PrepareTable
    | SwitchTable
    | Note
)
