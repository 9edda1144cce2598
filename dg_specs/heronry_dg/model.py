"""The model of a spec, as the loader gives it to all other code: immutable, checked and exact.

Quantities are integers: CPU in thousandths of a reference core, memory in bytes, rates in millihertz, bandwidth in
bit/s, times in nanoseconds. Shares (`max_load`, `reserve`) are exact fractions.

Mappings keep the order of the file, and that order carries meaning:

- The modes of a module are listed best first.
- The first phase is the initial one.
- The first branch of a DEMUX is its primary branch; with `to`, the first end is.
- Ties in the allocation of identifiers go to the earlier name.

The loader ensures of every `Spec`:

- Names are unique within their kind, and every name that is used exists.
- The buses form a forest: between two PEs there is at most one route.
- Every cycle of wires passes through a variable with an `initial` value.
- Every gate has a legal number of inputs.
- A DEMUX has at least two branches, and one end for each branch (`demux_paths`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal

from heronry_dg.gates import Expression, Leaf, leaves, with_leaves
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS, USUAL_MISSES

CRITICALITIES = ("A", "B", "C", "D", "E")
Criticality = Literal["A", "B", "C", "D", "E"]

# Marks in the metadata of fields, for the digest of a spec (`meaning`).
ONLY_ANALYSIS = "only analysis"  # the field changes no plan, table or flight
IN_ANY_ORDER = "in any order"  # the field is a map whose order has no meaning


@dataclass(frozen=True, slots=True)
class Bus:
    """One CAN segment."""

    name: str
    bitrate: int  # bit/s
    max_load: Fraction = Fraction(8, 10)
    reserve: Fraction = Fraction(1, 10)  # the share of the bit rate kept for management
    kind: Literal["wired", "wireless"] = "wired"
    channels: int = 1  # 2: replicated, every frame on both
    heartbeat_ns: int = USUAL_HEARTBEAT_NS
    misses: int = USUAL_MISSES
    rate_per_h: Fraction | None = field(default=None, metadata={ONLY_ANALYSIS: True})


@dataclass(frozen=True, slots=True)
class Manager:
    """The bus of the managers, and the policy of PEs that hear no manager."""

    bus: str
    without_manager: Literal["keep", "safe_mode"] = "keep"


@dataclass(frozen=True, slots=True)
class Pe:
    """A processing element; on two or more buses it is a gateway."""

    name: str
    node_id: int  # 92..125
    buses: tuple[str, ...]
    cpu_millis: int  # usable capacity, thousandths of a reference core
    ram: int  # bytes
    flash: int  # bytes
    features: frozenset[str] = frozenset()
    table_bytes: int = 4096
    rate_per_h: Fraction | None = field(default=None, metadata={ONLY_ANALYSIS: True})


@dataclass(frozen=True, slots=True)
class Device:
    """A sensor or an actuator, connected to one PE."""

    name: str
    kind: Literal["sensor", "actuator"]
    pe: str
    rate_per_h: Fraction | None = field(default=None, metadata={ONLY_ANALYSIS: True})


@dataclass(frozen=True, slots=True)
class Variable:
    """A datum that modules exchange, in one or more versions (qualities), of which 1 is the best."""

    name: str
    type: str  # the name of a CANaerospace data type
    unit: str | None = None
    versions: int = 1
    identifier: int | None = None  # a standard CANaerospace identifier; None: one is allocated
    initial: int | float | str | tuple[int, ...] | None = None
    deadline_ns: int | None = None  # None: the period of its producer's mode


@dataclass(frozen=True, slots=True)
class Mode:
    """One way to run a module."""

    name: str
    needs: Expression | None
    gives: Mapping[str, int]  # variable -> version
    cpu_millis: int
    ram: int  # bytes
    rate_mhz: int

    def leaves(self) -> Iterator[tuple[str, Leaf]]:
        """Give (path, leaf) for every input of this mode; the path is the position in `needs`, for example 0.1."""
        return leaves(self.needs)

    def in_phase(self, phase: str | None) -> "Mode":
        """Give a copy of the mode for a phase: inputs that are not wired in that phase accept no version.

        phase: name of the phase; None: every input stays as it is.
        """
        if self.needs is None:
            return self
        needs = with_leaves(self.needs, lambda leaf: leaf if leaf.is_open_in(phase) else leaf.closed())
        return replace(self, needs=needs)


@dataclass(frozen=True, slots=True)
class Module:
    """A piece of software that is started, stopped and moved as a whole."""

    name: str
    image: str
    modes: Mapping[str, Mode]  # best first
    device: str | None = None
    runs_on: tuple[str, ...] | None = None  # None: any PE
    requires: frozenset[str] = frozenset()
    flash: int = 0  # bytes
    partition: str | None = None  # None: the partition of the best criticality that it could serve
    restarts: int = 2
    checkpoint: bool | int | str | None = None
    rate_per_h: Fraction | None = field(default=None, metadata={ONLY_ANALYSIS: True})

    def in_phase(self, phase: str | None) -> "Module":
        """Give a copy of the module for a phase: inputs that are not wired in that phase accept no version.

        phase: None: `only_in` is ignored, so every input stays as it is.
        """
        return replace(self, modes={name: mode.in_phase(phase) for name, mode in self.modes.items()})

    def mode_index(self, mode: str) -> int:
        """Position of a mode; 0 is the best."""
        return list(self.modes).index(mode)


@dataclass(frozen=True, slots=True)
class Demux:
    """A gate of which at most one branch runs; a branch is a module, and may begin a path of modules."""

    name: str
    variable: str
    branches: tuple[str, ...]  # modules, in the spec's order: the first is the primary
    to: tuple[str, ...] = ()  # modules at which the paths end, the preferred one first; (): each branch is its own end

    @property
    def ends(self) -> tuple[str, ...]:
        """Modules of which one runs while the DEMUX serves a function, the preferred module first.

        These are the modules of `to`; if `to` is empty, they are the branches.
        """
        return self.to or self.branches

    @property
    def exclusives(self) -> Mapping[str, tuple[str, ...]]:
        """Give the branches under the name of the DEMUX, and the modules of `to`, if there are any, under `NAME.to`.

        At most one module of each of these groups may run.
        """
        things = {self.name: self.branches}
        return {**things, f"{self.name}.to": self.to} if self.to else things


@dataclass(frozen=True, slots=True)
class Function:
    """A system output: the root of one dependency graph."""

    name: str
    output: str  # a module, or a DEMUX
    outputs: tuple[str, ...]  # that module, or the ends of that DEMUX
    # By phase; key None: all other phases.
    criticality: Mapping[str | None, Criticality] = field(metadata={IN_ANY_ORDER: True})
    priority: Mapping[str | None, int] = field(metadata={IN_ANY_ORDER: True})
    value: tuple[int, ...] | None = None  # by mode of the output module; None: 100 (m - i) / m for mode i (from 0) of m
    priority_range: tuple[int, int] | None = None  # within which application code may change the priority; None: never

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


@dataclass(frozen=True, slots=True)
class When:
    """The rule by which a phase is entered automatically.

    The phase begins when `variable` has been above `above` for `hold_ns` without a break; if the rule has `below`
    instead, when it has been below `below` for that time.
    """

    variable: str
    above: Fraction | None
    below: Fraction | None
    hold_ns: int
    origins: tuple[str, ...]  # phases from which the rule leads here (`from`)


@dataclass(frozen=True, slots=True)
class Phase:
    """A mission phase, and the rule by which it is entered automatically; `when` is None if there is no rule."""

    name: str
    when: When | None = None


@dataclass(frozen=True, slots=True)
class Plant:
    """A part of the physical world: what moves it, what sees it, and the plants that it affects.

    Actuators move a plant, and sensors see it. No planner reads plants.
    """

    name: str
    moved_by: tuple[str, ...] = ()  # actuators
    seen_by: tuple[str, ...] = ()  # sensors
    affects: tuple[str, ...] = ()  # plants
    criticality: Criticality = "E"


@dataclass(frozen=True, slots=True)
class Contingency:
    """What to plan ahead for: the number of simultaneous faults, and the phases."""

    faults: int = 1
    phases: tuple[str, ...] | None = None  # None: all


@dataclass(frozen=True, slots=True)
class Spec:
    """The content of one spec file."""

    name: str
    digest: str  # SHA-256 of what the spec means, hexadecimal (`meaning`)
    buses: Mapping[str, Bus]
    manager: Manager
    pes: Mapping[str, Pe]
    devices: Mapping[str, Device]
    variables: Mapping[str, Variable]
    demuxes: Mapping[str, Demux]
    shorthands: Mapping[str, Expression]  # named gates that are no DEMUX; modules have their expressions instead
    modules: Mapping[str, Module]
    functions: Mapping[str, Function]
    phases: Mapping[str, Phase] = field(default_factory=dict)  # the first is the initial one
    separate: tuple[tuple[str, ...], ...] = ()
    together: tuple[tuple[str, ...], ...] = ()
    contingency: Contingency = Contingency()
    plants: Mapping[str, Plant] = field(default_factory=dict)

    def exclusive_things(self) -> dict[str, tuple[str, ...]]:
        """Give the names of the groups in `Demux.exclusives` to which a module belongs, by name of the module.

        At most one module of a group may run. A module that is neither a branch nor an end of a DEMUX is left out.
        """
        things: dict[str, tuple[str, ...]] = {}
        for demux in self.demuxes.values():
            for thing, modules in demux.exclusives.items():
                for module in modules:
                    things[module] = (*things.get(module, ()), thing)
        return things

    def initial_phase(self) -> str | None:
        """Name of the phase that is assumed when none is given; None where the spec has no phases."""
        return next(iter(self.phases), None)

    def in_phase(self, phase: str | None) -> "Spec":
        """Give the spec as a planner sees it in a phase.

        An input that `only_in` restricts to other phases accepts no version. If there is no such input, the result is
        this object itself.
        """
        closed = {
            module.name: module.in_phase(phase)
            for module in self.modules.values()
            if any(not leaf.is_open_in(phase) for mode in module.modes.values() for _, leaf in mode.leaves())
        }
        return replace(self, modules={**self.modules, **closed}) if closed else self

    def producers(self, variable: str) -> Iterator[tuple[Module, Mode]]:
        """Give every (module, mode) that gives a variable, in the spec's order."""
        for module in self.modules.values():
            for mode in module.modes.values():
                if variable in mode.gives:
                    yield module, mode

    def sources(self) -> Iterator[tuple[str, str]]:
        """Give every (module, variable) where some mode of the module gives the variable, in the spec's order."""
        for module in self.modules.values():
            given = dict.fromkeys(v for mode in module.modes.values() for v in mode.gives)
            for variable in given:
                yield module.name, variable
