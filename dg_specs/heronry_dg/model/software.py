"""What runs: variables, modules and their modes, DEMUX gates, and the functions that all of them serve."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from heronry_dg.field_types import (
    MOST_VERSIONS,
    Cpu,
    Criticality,
    CriticalityByPhase,
    DataTypeName,
    Initial,
    Labels,
    MapOfCheckpoint,
    Memory,
    Names,
    Period,
    Points,
    PrintableText,
    PriorityByPhase,
    PriorityRange,
    Rate,
    Restarts,
    Unread,
    Version,
)
from heronry_dg.gates import Expression, Leaf, leaves, with_leaves
from heronry_dg.keys import Bounds, Found, Key
from heronry_dg.model.fallible import Fallible
from heronry_wire.checkpoint_frames import MOST_STATE_BYTES
from heronry_wire.identifiers import STANDARD_DATA_IDS


@dataclass(frozen=True, slots=True)
class Variable:
    """A datum that modules exchange, in one or more versions (qualities); version 1 is the best."""

    name: str
    type: Annotated[DataTypeName, Key("CANaerospace data type.", "FLOAT", "UCHAR")]
    unit: Annotated[PrintableText | None, Key("Physical unit.", "m", "deg/s")] = None
    versions: Annotated[
        int,
        Bounds(ge=1, le=MOST_VERSIONS),
        Key("Number of versions (qualities) of the variable; version 1 is the best.", 3),
    ] = 1
    identifier: Annotated[
        int | None,
        Bounds(ge=STANDARD_DATA_IDS.start, le=STANDARD_DATA_IDS.stop - 1),
        Key("Standard CANaerospace identifier; if left out, heronry allocates an identifier.", 322),
    ] = None
    initial: Annotated[
        Initial,
        Key("Value that readers get before the first datum; makes a wiring cycle through this variable legal.", 0),
    ] = None
    deadline_ns: Annotated[
        Period | None,
        Key(
            "Longest time in ms from producer to consumer; if left out, the producer's period.",
            25,
            called="deadline_ms",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Mode:
    """One way to run a module; modes are listed best first."""

    name: str
    needs: Annotated[
        Expression | None,
        Unread,
        Key(
            "Condition on the inputs, as a gate expression over variables; without it the mode has no inputs.",
            "altitude",
            {"or": {"k": 1, "of": ["altitude@<=2", "release_command"]}},
            left_out=None,
        ),
    ]
    gives: Annotated[
        Mapping[str, Version],
        Key("Variables that the mode gives, each with its version.", {"altitude": 1}, left_out={}),
    ]
    cpu_millis: Annotated[Cpu, Key("CPU that the mode takes, in reference cores.", 0.05, called="cpu")]
    ram: Annotated[Memory, Key("RAM that the mode takes.", "2KiB")]
    rate_mhz: Annotated[
        Rate, Key("How often the module runs and publishes in this mode, in Hz.", 10, 12.5, called="rate_hz")
    ]

    def leaves(self) -> Iterator[tuple[str, Leaf]]:
        """Return (path, leaf) for every input of this mode; the path is the position in `needs`, for example 0.1."""
        return leaves(self.needs)

    def in_phase(self, phase: str | None) -> "Mode":
        """Return a copy of the mode for a phase: inputs that are not wired in that phase accept no version.

        phase: name of the phase; None: every input stays as it is.
        """
        if self.needs is None:
            return self
        needs = with_leaves(self.needs, lambda leaf: leaf if leaf.is_open_in(phase) else leaf.closed())
        return replace(self, needs=needs)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """How the state of a module is kept, so that the module goes on from it where it starts anew."""

    data_bytes: Annotated[
        int,
        Bounds(ge=1, le=MOST_STATE_BYTES),
        Key("Most bytes of the state: 8 for each number that `save` returns.", 64, called="bytes"),
    ]
    rate_mhz: Annotated[
        Rate, Key("How often the state is saved and sent to the other possible PEs, in Hz.", 5, called="hz")
    ]
    max_age_ns: Annotated[
        Period,
        Key(
            "Age in ms above which the state is not used: the module then starts without it.", 1000, called="max_age_ms"
        ),
    ]


@dataclass(frozen=True, slots=True)
class Module(Fallible):
    """A piece of software that is started, stopped and moved as a whole."""

    name: str
    image: Annotated[
        PrintableText,
        Key(
            "Code of the module: an image or package.module:Class; if left out, the image with the module's name.",
            "servo_driver",
            resolved="",
        ),
    ]
    modes: Annotated[Mapping[str, Mode], Found({})]  # best first
    device: Annotated[str | None, Key("Device that the module drives; the module runs on the device's PE.", "gps")] = (
        None
    )
    runs_on: Annotated[
        Names | None,
        Bounds(min_length=1),
        Key("PEs on which the module may run; any PE if left out.", ["nav", "flight"]),
    ] = None
    requires: Annotated[Labels, Key("Features that the module's PE must have.", ["fpu"])] = frozenset()
    flash: Annotated[Memory, Key("Flash that the module takes on its PE.", "4KiB")] = 0
    partition: Annotated[
        PrintableText | None,
        Key(
            "Name of the process that runs the module; several modules may share one process. "
            "By default there is one process for each criticality.",
            "control",
        ),
    ] = None
    restarts: Annotated[
        Restarts,
        Key("How many times the PE restarts a failed module; a minute without failure resets the count.", 0),
    ] = 2
    silent: Annotated[
        Literal["told", "fails"],
        Key(
            "What happens when the module leaves out an output for five periods, at least T_lease, although its inputs "
            "are there: `told` reports it; `fails` also makes the module failed on its PE.",
            "fails",
        ),
    ] = "told"
    checkpoint: Annotated[
        Annotated[Checkpoint, MapOfCheckpoint] | None,
        Key(
            "How the module's state is kept for a start after a failure, also on another PE; not at all if left out.",
            {"bytes": 64, "hz": 5, "max_age_ms": 1000},
        ),
    ] = None

    def in_phase(self, phase: str | None) -> "Module":
        """Return a copy of the module for a phase: inputs that are not wired in that phase accept no version.

        phase: None: `only_in` is ignored, so every input stays as it is.
        """
        return replace(self, modes={name: mode.in_phase(phase) for name, mode in self.modes.items()})

    def mode_index(self, mode: str) -> int:
        """Position of a mode; 0 is the best."""
        return list(self.modes).index(mode)


@dataclass(frozen=True, slots=True)
class Demux:
    """A gate of which at most one branch runs; its branches are the modules whose `needs` name it."""

    name: str
    variable: Annotated[str, Found("")]  # of the first input in front of it, which as a rule is the only one
    branches: Annotated[tuple[str, ...], Found(())]  # modules, in the spec's order: the first is the primary
    needs: Annotated[  # its leaves name the DEMUX; each branch has it in its own `needs`, too
        Expression,
        Unread,
        Key(
            "What the running branch reads: a variable, or any gate expression that names no DEMUX.",
            "elevator_demand",
            {"xor": ["elevator_demand@1", "elevator_demand@2"]},
            called="demux",
            repeats=True,
        ),
    ]
    to: Annotated[
        Names,
        Key(
            "Modules at which the branches end, one for each branch, the preferred module first. "
            "If left out, each branch is its own end.",
            ["driver_1", "driver_2"],
        ),
    ] = ()

    @property
    def ends(self) -> tuple[str, ...]:
        """Modules of which one runs while the DEMUX serves a function, the preferred module first.

        These are the modules of `to`; if `to` is empty, they are the branches.
        """
        return self.to or self.branches

    @property
    def demand(self) -> Expression:
        """The gate in front of it as the spec has it, whose leaves do not name the DEMUX."""
        return with_leaves(self.needs, lambda leaf: replace(leaf, demux=None))

    @property
    def exclusives(self) -> Mapping[str, tuple[str, ...]]:
        """Return the branches under the name of the DEMUX, and the modules of `to`, if there are any, under `NAME.to`.

        At most one module of each of these groups may run.
        """
        things = {self.name: self.branches}
        return {**things, f"{self.name}.to": self.to} if self.to else things


@dataclass(frozen=True, slots=True)
class Function:
    """A system output: the root of one dependency graph."""

    name: str
    output: Annotated[str, Key("The module, or the DEMUX gate, that gives the output.", "chute_driver")]
    outputs: Annotated[tuple[str, ...], Found(())]  # that module, or the ends of that DEMUX
    criticality: Annotated[
        CriticalityByPhase,
        Key(
            "Class A (served first) to E (not critical): one class for all phases, "
            "or classes by phase with a `default`.",
            "A",
            {"default": "C", "landing": "B"},
            left_out={None: "E"},
        ),
    ]  # key None: all other phases
    priority: Annotated[
        PriorityByPhase,
        Key(
            "Weight in the class (0: not wanted): one weight for all phases, or weights by phase with a `default`.",
            100,
            {"default": 20, "landing": 0},
            left_out={None: 1},
        ),
    ]
    value: Annotated[
        tuple[Points, ...] | None,
        Key(
            "Points for each mode of the output, best first; by default mode i of m modes (i from 0) has 100 (m-i)/m.",
            [100, 40],
        ),
    ] = None
    priority_range: Annotated[
        PriorityRange | None,
        Key("Lowest and highest priority that a module may request in flight; if left out, no module may.", [0, 100]),
    ] = None

    def criticality_in(self, phase: str | None) -> Criticality:
        """Criticality of the function in a phase; for None, that of all phases that the function does not name."""
        return self.criticality.get(phase, self.criticality[None])

    def priority_in(self, phase: str | None) -> int:
        """Priority of the function in a phase, as the spec has it; 0: the function is not wanted.

        `Situation.priority_of` gives the priority in flight, which a module or the operator may have changed.
        """
        return self.priority.get(phase, self.priority[None])

    def value_of(self, mode_index: int, mode_count: int) -> int:
        """Value of the function if served by mode number `mode_index` (0 is the best) of `mode_count`."""
        if self.value is not None:
            return self.value[mode_index]
        return 100 * (mode_count - mode_index) // mode_count
