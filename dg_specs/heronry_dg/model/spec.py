"""The content of a whole file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from heronry_dg.field_types import Hours, Name, Names
from heronry_dg.gates import Expression
from heronry_dg.keys import Bounds, Key
from heronry_dg.model.hardware import Bus, Device, Manager, Pe, Plant
from heronry_dg.model.mission import CommonCause, Contingency, Phase
from heronry_dg.model.software import Demux, Function, Mode, Module, Variable


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Fields that concern the whole file."""

    dg: Annotated[Literal[1], Key("Version of this format.", 1, required=True)] = 1
    name: Annotated[Name, Key("Name of the system; the file's name if left out.", "big_blue", resolved="")]
    separate: Annotated[
        tuple[Annotated[Names, Bounds(min_length=2)], ...],
        Key("Groups of modules; all modules of a group must run on different PEs.", [["a", "b"]]),
    ] = ()
    together: Annotated[
        tuple[Annotated[Names, Bounds(min_length=2)], ...],
        Key("Groups of modules; all modules of a group must run on the same PE.", [["a", "b"]]),
    ] = ()
    common_cause: Annotated[
        tuple[CommonCause, ...],
        Key(
            "Groups of elements that one cause takes down together; only analysis uses them.",
            [{"elements": ["pe:tail_a", "pe:tail_b"], "beta": 0.1}],
            analysis_only=True,
        ),
    ] = ()
    mission_h: Annotated[
        Hours | None,
        Key("Length of the mission in hours; 1 if left out; only analysis uses it.", 2.5, analysis_only=True),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec(Header):
    """A whole spec file. Names of elements match `[A-Za-z][A-Za-z0-9_]*`."""

    digest: str  # SHA-256 of what the spec means, hexadecimal (`meaning`)
    buses: Annotated[Mapping[str, Bus], Key("CAN segments by name.", {"can0": {"bitrate": 1000000}}, left_out={})]
    manager: Annotated[Manager, Key("The bus of the managers.", {"bus": "can0"}, left_out=Manager(""))]
    pes: Annotated[
        Mapping[str, Pe],
        Key(
            "Processing elements by name.",
            {"nav": {"node_id": 92, "buses": ["can0"], "cpu": 0.5, "ram": "32KiB", "flash": "64KiB"}},
            left_out={},
        ),
    ]
    devices: Annotated[
        Mapping[str, Device],
        Key("Sensors and actuators by name.", {"gps": {"kind": "sensor", "pe": "nav"}}, left_out={}),
    ]
    variables: Annotated[
        Mapping[str, Variable],
        Key(
            "Data that modules exchange, by name.",
            {"altitude": {"type": "FLOAT", "unit": "m", "versions": 3}},
            left_out={},
        ),
    ]
    demuxes: Annotated[
        Mapping[str, Demux],
        Key(
            "Named gates: a DEMUX, or a shorthand for an expression.",
            {"elevator_out": {"demux": "elevator_demand"}, "position": {"and": ["latitude", "longitude"]}},
            called="gates",
            left_out={},
        ),
    ]
    shorthands: Mapping[str, Expression]  # named gates that are no DEMUX; modules have their expressions instead
    modules: Annotated[
        Mapping[str, Module],
        Key(
            "Modules by name.",
            {"gps_driver": {"device": "gps", "gives": {"altitude": 1}, "cpu": 0.1, "ram": 1024, "rate_hz": 10}},
            left_out={},
        ),
    ]
    functions: Annotated[
        Mapping[str, Function],
        Key(
            "System outputs by name.",
            {"parachute": {"output": "chute_driver", "criticality": "A", "priority": 100}},
            left_out={},
        ),
    ]
    phases: Annotated[
        Mapping[str, Phase],
        Key(
            "Mission phases by name; the first is the initial one.",
            {"climb": {}, "glide": {"when": {"variable": "altitude", "above": 17000}}},
        ),
    ] = field(default_factory=dict)
    plants: Annotated[
        Mapping[str, Plant],
        Key(
            "Parts of the physical world by name; plans do not depend on them.",
            {"pitch": {"moved_by": ["elevator_servo"], "seen_by": ["pitch_gyro"], "criticality": "A"}},
        ),
    ] = field(default_factory=dict)
    contingency: Annotated[
        Contingency, Key("For how many faults, and for which phases, plans are made ahead.", {"faults": 2})
    ] = field(default=Contingency())

    def rivals(self) -> tuple[tuple[str, ...], ...]:
        """Return groups of modules of which at most one may run: branches and ends of DEMUXes, drivers of one actuator.

        An actuator with a single driver gives no group.
        """
        of_demuxes = [group for demux in self.demuxes.values() for group in demux.exclusives.values()]
        return (*of_demuxes, *self.drivers_of_one_actuator().values())

    def drivers_of_one_actuator(self) -> dict[str, tuple[str, ...]]:
        """Return the drivers of each actuator that has two or more, by name of the actuator (semantics rule 10)."""
        drivers: dict[str, tuple[str, ...]] = {}
        for module in self.modules.values():
            if module.device is not None and self.devices[module.device].kind == "actuator":
                drivers[module.device] = (*drivers.get(module.device, ()), module.name)
        return {device: modules for device, modules in drivers.items() if len(modules) > 1}

    def exclusive_things(self) -> dict[str, tuple[str, ...]]:
        """Return the names of the groups in `Demux.exclusives` to which a module belongs, by name of the module.

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
        """Return the spec as a planner sees it in a phase.

        An input that `only_in` restricts to other phases accepts no version. If there is no such input, the result is
        this object itself.
        """
        if phase is None:
            return self
        closed = {
            module.name: module.in_phase(phase)
            for module in self.modules.values()
            if any(not leaf.is_open_in(phase) for mode in module.modes.values() for _, leaf in mode.leaves())
        }
        return replace(self, modules={**self.modules, **closed}) if closed else self

    def producers(self, variable: str) -> Iterator[tuple[Module, Mode]]:
        """Yield every (module, mode) that gives a variable, in the spec's order."""
        for module in self.modules.values():
            for mode in module.modes.values():
                if variable in mode.gives:
                    yield module, mode

    def sources(self) -> Iterator[tuple[str, str]]:
        """Yield every (module, variable) where some mode of the module gives the variable, in the spec's order."""
        for module in self.modules.values():
            given = dict.fromkeys(v for mode in module.modes.values() for v in mode.gives)
            for variable in given:
                yield module.name, variable
