"""The fields of a spec: their allowed values, meanings and defaults.

There is one pydantic model per kind of element, with a description and examples of each field. The JSON schema is
generated from these models. A model checks one element by itself; reference_rules.py checks whether names refer to
something. Field names are those of the file. If the model has another unit than the file, the attribute has another
name than the field (`rate_hz` becomes `rate_mhz`).

Gate expressions are `Any` here: expression_reader.py reads them from the tree of the YAML file, because findings about
a gate must name places inside the expression.
"""

from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Final, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    model_validator,
)

from heronry_dg.field_types import (
    MOST_VERSIONS,
    NAME_PATTERN,
    Capacity,
    Checkpoint,
    Cpu,
    CriticalityByPhase,
    DataTypeName,
    FailureRate,
    Memory,
    Names,
    Period,
    Points,
    PositiveMemory,
    PrintableText,
    PriorityByPhase,
    PriorityRange,
    Rate,
    Restarts,
    Share,
    Span,
    Threshold,
    Version,
)
from heronry_dg.model import Bus, Contingency, Criticality, Manager, Module, Pe, Plant, Variable
from heronry_wire.identifiers import FIRST_PE, LAST_PE, STANDARD_DATA_IDS

ONLY_MODE: Final = "only"
_NS_PER_MS: Final = 1_000_000


def _default(element: type, field: str) -> Any:
    """Give the default of a field from the model, the only place that defines it."""
    return next(one.default for one in fields(element) if one.name == field)


class Form(BaseModel):
    """Base of all elements: no unknown fields, no conversion of types; a key without a value counts as left out."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _leave_out_nothing(cls, fields: object) -> object:
        if isinstance(fields, dict):
            return {key: value for key, value in fields.items() if value is not None or key not in field_names(cls)}
        return fields


@cache
def field_names(form: type[Form]) -> tuple[str, ...]:
    """Give the field names of a kind of element, as the file spells them."""
    return tuple(field.alias or name for name, field in form.model_fields.items())


class Fallible(Form):
    """An element that may have a failure rate."""

    rate_per_h: FailureRate | None = Field(
        default=None, description="Failures per hour; only analysis uses it.", examples=[0.0005, 1e-5]
    )


class BusForm(Fallible):
    """One CAN segment."""

    bitrate: int = Field(gt=0, le=1_000_000_000, description="Bit rate in bit/s.", examples=[1000000])
    max_load: Share = Field(
        default=_default(Bus, "max_load"),
        description="Largest share of the bit rate that may be used; 0.8 is the CANaerospace rule.",
        examples=[0.8],
        json_schema_extra={"default": float(_default(Bus, "max_load"))},
    )
    reserve: Share = Field(
        default=_default(Bus, "reserve"),
        description="Share of the bit rate kept for management; data may use max_load - reserve.",
        examples=[0.1],
        json_schema_extra={"default": float(_default(Bus, "reserve"))},
    )
    kind: Literal["wired", "wireless"] = Field(
        default=_default(Bus, "kind"),
        description="Whether the bus is wired; on a wireless bus only bandwidth is checked, and not response times.",
        examples=["wired"],
    )
    channels: int = Field(
        default=_default(Bus, "channels"),
        ge=1,
        le=2,
        description="Number of channels; with 2 the bus is replicated: every frame is sent on both.",
        examples=[1],
    )
    heartbeat_ns: Period = Field(
        default=_default(Bus, "heartbeat_ns") // _NS_PER_MS,
        validate_default=True,
        alias="heartbeat_ms",
        description="Period in ms of each PE's state frame on this bus.",
        examples=[20, 12.5],
    )
    misses: int = Field(
        default=_default(Bus, "misses"),
        ge=1,
        le=255,
        description="Number of heartbeat periods without a state after which a PE counts as down.",
        examples=[3],
    )


class ManagerForm(Form):
    """The bus of the managers, and what PEs do while they hear no manager."""

    bus: str | None = Field(
        default=None, description="Bus of the managers; the first wired bus if left out.", examples=["can0"]
    )
    without_manager: Literal["keep", "safe_mode"] = Field(
        default=_default(Manager, "without_manager"),
        description="What PEs do while they hear no manager: keep all modules, or stop those serving nothing critical.",
        examples=["keep"],
    )


class PeForm(Fallible):
    """A processing element; on two or more buses it is a gateway."""

    node_id: int = Field(ge=FIRST_PE, le=LAST_PE, description="CANaerospace and CANopen node-ID.", examples=[92])
    buses: Names = Field(
        min_length=1, description="Buses of the PE; with two or more the PE is a gateway.", examples=[["can0"]]
    )
    cpu_millis: Capacity = Field(
        alias="cpu", description="CPU capacity that modules may use, in reference cores.", examples=[0.5]
    )
    ram: PositiveMemory = Field(description="RAM that modules may use.", examples=["32KiB"])
    flash: PositiveMemory = Field(description="Flash that modules may use.", examples=["64KiB"])
    features: Names = Field(default=[], description="Labels that a module may require.", examples=[["fpu"]])
    table_bytes: PositiveMemory = Field(
        default=_default(Pe, "table_bytes"),
        description="Memory for the PE's table, with modules and contingencies.",
        examples=["4KiB"],
    )


class DeviceForm(Fallible):
    """A sensor or an actuator, connected to one PE."""

    kind: Literal["sensor", "actuator"] = Field(
        description="Whether the device gives data (sensor) or takes data (actuator).", examples=["sensor"]
    )
    pe: str = Field(description="PE to which the device is connected.", examples=["tail_pe"])


class VariableForm(Form):
    """A datum that modules exchange, in one or more versions (qualities); version 1 is the best."""

    type: DataTypeName = Field(description="CANaerospace data type.", examples=["FLOAT", "UCHAR"])
    unit: PrintableText | None = Field(default=None, description="Physical unit.", examples=["m", "deg/s"])
    versions: int = Field(
        default=_default(Variable, "versions"),
        ge=1,
        le=MOST_VERSIONS,
        description="Number of versions (qualities) of the variable; version 1 is the best.",
        examples=[3],
    )
    identifier: int | None = Field(
        default=None,
        ge=STANDARD_DATA_IDS.start,
        le=STANDARD_DATA_IDS.stop - 1,
        description="Standard CANaerospace identifier; if left out, heronry allocates an identifier.",
        examples=[322],
    )
    initial: Any = Field(
        default=None,
        description="Value that readers get before the first datum; makes a wiring cycle through this variable legal.",
        examples=[0],
    )
    deadline_ns: Period | None = Field(
        default=None,
        alias="deadline_ms",
        description="Longest time in ms from producer to consumer; if left out, the producer's period.",
        examples=[25],
    )


class ModeForm(Form):
    """One way to run a module; modes are listed best first."""

    needs: Any = Field(
        default=None,
        description="Condition on the inputs, as a gate expression over variables; without it the mode has no inputs.",
        examples=["altitude", {"or": {"k": 1, "of": ["altitude@<=2", "release_command"]}}],
    )
    gives: dict[str, Version] = Field(
        default={}, description="Variables that the mode gives, each with its version.", examples=[{"altitude": 1}]
    )
    cpu_millis: Cpu = Field(alias="cpu", description="CPU that the mode takes, in reference cores.", examples=[0.05])
    ram: Memory = Field(description="RAM that the mode takes.", examples=["2KiB"])
    rate_mhz: Rate = Field(
        alias="rate_hz", description="How often the module runs and publishes in this mode, in Hz.", examples=[10, 12.5]
    )


class ModuleForm(Fallible):
    """The fields of a module besides its modes."""

    image: PrintableText | None = Field(
        default=None,
        description="Code of the module: an image or package.module:Class; "
        "if left out, the image with the module's name.",
        examples=["servo_driver"],
    )
    device: str | None = Field(
        default=None, description="Device that the module drives; the module runs on the device's PE.", examples=["gps"]
    )
    runs_on: Names | None = Field(
        default=None,
        min_length=1,
        description="PEs on which the module may run; any PE if left out.",
        examples=[["nav", "flight"]],
    )
    requires: Names = Field(default=[], description="Features that the module's PE must have.", examples=[["fpu"]])
    flash: Memory = Field(
        default=_default(Module, "flash"), description="Flash that the module takes on its PE.", examples=["4KiB"]
    )
    partition: PrintableText | None = Field(
        default=None,
        description="Name of the process that runs the module; several modules may share one process. "
        "By default there is one process for each criticality.",
        examples=["control"],
    )
    restarts: Restarts = Field(
        default=_default(Module, "restarts"),
        description="How many times the PE restarts a failed module; a minute without failure resets the count.",
        examples=[0],
    )
    checkpoint: Checkpoint | None = Field(
        default=None,
        description="Whether, or how, the module's state is kept for a restart on another PE.",
        examples=[True],
    )


class ModuleOfOneModeForm(ModuleForm, ModeForm):
    """A module with a single mode, named `only`; the fields of this mode are written at the module itself."""


class ModuleOfModesForm(ModuleForm):
    """A module that lists its modes."""

    modes: dict[str, ModeForm] = Field(
        min_length=1,
        description="Modes by name, best first.",
        examples=[{"fused": {"needs": "altitude", "cpu": 0.1, "ram": "2KiB", "rate_hz": 10}}],
    )


class FunctionForm(Form):
    """A system output: the root of one dependency graph."""

    output: str = Field(description="The module, or the DEMUX gate, that gives the output.", examples=["chute_driver"])
    criticality: CriticalityByPhase = Field(
        default="E",
        validate_default=True,
        description="Class A (served first) to E (not critical): one class for all phases, "
        "or classes by phase with a `default`.",
        examples=["A", {"default": "C", "landing": "B"}],
    )
    priority: PriorityByPhase = Field(
        default=1,
        validate_default=True,
        description="Weight in the class (0: not wanted): one weight for all phases, "
        "or weights by phase with a `default`.",
        examples=[100, {"default": 20, "landing": 0}],
    )
    value: list[Points] | None = Field(
        default=None,
        description="Points for each mode of the output, best first; "
        "by default mode i of m modes (i from 0) has 100 (m-i)/m.",
        examples=[[100, 40]],
    )
    priority_range: PriorityRange | None = Field(
        default=None,
        description="Lowest and highest priority that a module may request in flight; if left out, no module may.",
        examples=[[0, 100]],
    )


class WhenForm(Form):
    """The rule of a phase: when the phase is entered automatically.

    The variable must be above the threshold `above`, or below the threshold `below`, for the time `hold_ms`.
    """

    variable: str = Field(description="Variable that the rule watches.", examples=["altitude"])
    above: Threshold = Field(default=None, description="Threshold that the variable must exceed.", examples=[17000])
    below: Threshold = Field(default=None, description="Threshold that the variable must fall below.", examples=[300])
    hold_ns: Span = Field(
        default=0,
        validate_default=True,
        alias="hold_ms",
        description="Time in ms for which the condition must hold without a break.",
        examples=[500],
    )
    origins: Names | None = Field(
        default=None,
        min_length=1,
        alias="from",
        description="Phases in which the rule applies; if left out, all phases that are listed before this one.",
        examples=[["glide", "landing"]],
    )


class PhaseForm(Form):
    """A mission phase; the first one listed is the initial one."""

    when: WhenForm | None = Field(
        default=None,
        description="Rule by which the phase is entered automatically.",
        examples=[{"variable": "altitude", "above": 17000, "hold_ms": 500}],
    )


class PlantForm(Form):
    """A part of the physical world that is controlled.

    What is controlled on several axes is written as several plants.
    """

    moved_by: Names = Field(default=[], description="Actuators that act on the plant.", examples=[["elevator_servo"]])
    seen_by: Names = Field(default=[], description="Sensors that measure the plant.", examples=[["pitch_gyro"]])
    affects: Names = Field(default=[], description="Other plants on which this plant acts.", examples=[["altitude"]])
    criticality: Criticality = Field(
        default=_default(Plant, "criticality"),
        description="How bad it is to lose control of the plant: A (worst) to E (not critical).",
        examples=["A"],
    )


class ContingencyForm(Form):
    """How many simultaneous faults, and which phases, the plans made ahead cover."""

    faults: int = Field(
        default=_default(Contingency, "faults"),
        ge=0,
        le=8,
        description="Number of simultaneous faults to plan ahead for.",
        examples=[2],
    )
    phases: Names | None = Field(
        default=None, description="Phases to plan for; all phases if left out.", examples=[["landing"]]
    )


class DemuxForm(Form):
    """A gate of which at most one branch runs; its branches are the modules whose `needs` name it."""

    demux: str = Field(description="Variable that the running branch reads.", examples=["elevator_demand"])
    to: Names = Field(
        default=[],
        description="Modules at which the branches end, one for each branch, the preferred module first. "
        "If left out, each branch is its own end.",
        examples=[["driver_1", "driver_2"]],
    )


class HeaderForm(Form):
    """Fields that concern the whole file."""

    dg: Literal[1] = Field(description="Version of this format.", examples=[1])
    name: str | None = Field(
        default=None,
        pattern=f"^{NAME_PATTERN}$",
        description="Name of the system; the file's name if left out.",
        examples=["big_blue"],
    )
    separate: list[Annotated[Names, Field(min_length=2)]] = Field(
        default=[],
        description="Groups of modules; all modules of a group must run on different PEs.",
        examples=[[["a", "b"]]],
    )
    together: list[Annotated[Names, Field(min_length=2)]] = Field(
        default=[],
        description="Groups of modules; all modules of a group must run on the same PE.",
        examples=[[["a", "b"]]],
    )


class SpecForm(HeaderForm):
    """A whole spec file. Names of elements match `[A-Za-z][A-Za-z0-9_]*`."""

    buses: dict[str, BusForm] = Field(
        default={}, description="CAN segments by name.", examples=[{"can0": {"bitrate": 1000000}}]
    )
    manager: ManagerForm = Field(
        default=ManagerForm(), description="The bus of the managers.", examples=[{"bus": "can0"}]
    )
    pes: dict[str, PeForm] = Field(
        default={},
        description="Processing elements by name.",
        examples=[{"nav": {"node_id": 92, "buses": ["can0"], "cpu": 0.5, "ram": "32KiB", "flash": "64KiB"}}],
    )
    devices: dict[str, DeviceForm] = Field(
        default={}, description="Sensors and actuators by name.", examples=[{"gps": {"kind": "sensor", "pe": "nav"}}]
    )
    variables: dict[str, VariableForm] = Field(
        default={},
        description="Data that modules exchange, by name.",
        examples=[{"altitude": {"type": "FLOAT", "unit": "m", "versions": 3}}],
    )
    gates: dict[str, Any] = Field(
        default={},
        description="Named gates: a DEMUX, or a shorthand for an expression.",
        examples=[{"elevator_out": {"demux": "elevator_demand"}, "position": {"and": ["latitude", "longitude"]}}],
    )
    modules: dict[str, ModuleOfModesForm | ModuleOfOneModeForm] = Field(
        default={},
        description="Modules by name.",
        examples=[{"gps_driver": {"device": "gps", "gives": {"altitude": 1}, "cpu": 0.1, "ram": 1024, "rate_hz": 10}}],
    )
    functions: dict[str, FunctionForm] = Field(
        default={},
        description="System outputs by name.",
        examples=[{"parachute": {"output": "chute_driver", "criticality": "A", "priority": 100}}],
    )
    phases: dict[str, PhaseForm] = Field(
        default={},
        description="Mission phases by name; the first is the initial one.",
        examples=[{"climb": {}, "glide": {"when": {"variable": "altitude", "above": 17000}}}],
    )
    plants: dict[str, PlantForm] = Field(
        default={},
        description="Parts of the physical world by name; plans do not depend on them.",
        examples=[{"pitch": {"moved_by": ["elevator_servo"], "seen_by": ["pitch_gyro"], "criticality": "A"}}],
    )
    contingency: ContingencyForm = Field(
        default=ContingencyForm(),
        description="For how many faults, and for which phases, plans are made ahead.",
        examples=[{"faults": 2}],
    )
