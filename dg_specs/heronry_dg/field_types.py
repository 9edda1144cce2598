"""The types of the fields of a spec: which values are allowed, how they are read, what the JSON schema says of them.

`schema` has the fields. A value that does not fit raises UnfitError, whose sentence `draft` turns into a finding.
"""

from fractions import Fraction
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, WithJsonSchema

from heronry_dg import quantities
from heronry_dg.findings import shown
from heronry_dg.model import CRITICALITIES, Criticality
from heronry_dg.quantities import UnfitError
from heronry_dg.rules import schema as rules
from heronry_wire.canaerospace import DataType
from heronry_wire.management import MOST_PRIORITY

NAME_PATTERN: Final = "[A-Za-z][A-Za-z0-9_]{0,63}"  # valid in C and DBC; without '=' and '%', as in pe:NAME=40%
DEFAULT_PHASE: Final = "default"
MOST_VERSIONS: Final = 15  # a version takes four bits of the frame's service code
MOST_RESTARTS: Final = 10  # the delay before a restart doubles each time
MOST_POINTS: Final = 1_000_000  # of a priority, a value, a worth: sums of their products stay inside 64 bits


def _number_schema(description: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "number", "minimum": 0, "description": description})


def _by_phase_schema(one: dict[str, Any]) -> WithJsonSchema:
    by_phase = {"type": "object", "additionalProperties": one, "required": [DEFAULT_PHASE]}
    return WithJsonSchema({"anyOf": [one, by_phase]})


def _different(names: list[str]) -> list[str]:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise UnfitError(rules.LISTED_TWICE, f"names {shown(name)} twice", "remove one of them")
        seen.add(name)
    return names


def _for_all_phases(value: object) -> object:
    return value if isinstance(value, dict) else {DEFAULT_PHASE: value}


def _with_default(by_phase: dict[str, Any]) -> dict[str, Any]:
    if DEFAULT_PHASE not in by_phase:
        hint = f"add '{DEFAULT_PHASE}', with the value for all other phases"
        raise UnfitError(rules.NO_DEFAULT, f"gives no '{DEFAULT_PHASE}'", hint)
    return by_phase


def _checkpoint(value: object) -> bool | int | str:
    if isinstance(value, bool | str) or (isinstance(value, int) and value >= 0):
        return value
    sentence = f"must be true, false, a whole number or a name, not {shown(value)}"
    raise UnfitError(rules.WRONG_TYPE, sentence, "write checkpoint: true")


def _priority_range(value: object) -> tuple[int, int]:
    match value:
        case [int(low), int(high)] if bool not in (type(low), type(high)) and 0 <= low <= high <= MOST_PRIORITY:
            return low, high
        case _:
            pass
    sentence = f"must be a list of two whole numbers from 0 to {MOST_PRIORITY}: the lowest priority, then the highest"
    raise UnfitError(rules.WRONG_TYPE, sentence, "write priority_range: [0, 100]")


def _optional_number(value: object) -> Fraction | None:
    return None if value is None else quantities.number(value)


_MEMORY_SCHEMA = WithJsonSchema(
    {
        "anyOf": [
            {"type": "integer", "minimum": 0},
            {"type": "string", "pattern": r"^[0-9]+(\.[0-9]+)?(KiB|MiB|GiB)$"},
        ]
    }
)
Cpu = Annotated[int, PlainValidator(quantities.cpu_millis), _number_schema("reference cores, to a thousandth")]
Capacity = Annotated[
    int, PlainValidator(quantities.positive_cpu_millis), _number_schema("reference cores, to a thousandth")
]
Memory = Annotated[int, PlainValidator(quantities.memory_bytes), _MEMORY_SCHEMA]
PositiveMemory = Annotated[int, PlainValidator(quantities.positive_memory_bytes), _MEMORY_SCHEMA]
Rate = Annotated[int, PlainValidator(quantities.rate_mhz), _number_schema("Hz, to a thousandth")]
Period = Annotated[int, PlainValidator(quantities.period_ns), _number_schema("ms, to a nanosecond")]
Span = Annotated[int, PlainValidator(quantities.span_ns), _number_schema("ms, to a nanosecond")]
Share = Annotated[Fraction, PlainValidator(quantities.share), _number_schema("a share, 0 to 1")]
FailureRate = Annotated[Fraction, PlainValidator(quantities.failures_per_hour), _number_schema("failures per hour")]
Threshold = Annotated[Fraction | None, PlainValidator(_optional_number), WithJsonSchema({"type": "number"})]
Names = Annotated[list[str], AfterValidator(_different), Field(json_schema_extra={"uniqueItems": True})]
Version = Annotated[int, Field(ge=1)]
PriorityRange = Annotated[
    tuple[int, int],
    PlainValidator(_priority_range),
    WithJsonSchema(
        {
            "type": "array",
            "items": {"type": "integer", "minimum": 0, "maximum": MOST_PRIORITY},
            "minItems": 2,
            "maxItems": 2,
        }
    ),
]
Restarts = Annotated[int, Field(ge=0, le=MOST_RESTARTS)]
Points = Annotated[int, Field(ge=0, le=MOST_POINTS)]
PrintableText = Annotated[str, Field(min_length=1, max_length=64, pattern=r'^[^\x00-\x1f\x7f"\\]*$')]
Checkpoint = Annotated[
    bool | int | str, PlainValidator(_checkpoint), WithJsonSchema({"type": ["boolean", "integer", "string"]})
]
CriticalityByPhase = Annotated[
    dict[str, Criticality],
    BeforeValidator(_for_all_phases),
    AfterValidator(_with_default),
    _by_phase_schema({"enum": list(CRITICALITIES)}),
]
PriorityByPhase = Annotated[
    dict[str, Points],
    BeforeValidator(_for_all_phases),
    AfterValidator(_with_default),
    _by_phase_schema({"type": "integer", "minimum": 0, "maximum": MOST_POINTS}),
]
DataTypeName = Annotated[str, WithJsonSchema({"enum": [data_type.name for data_type in DataType]})]
