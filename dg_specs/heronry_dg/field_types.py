"""The types of the keys of a spec: which values are allowed, how they are read, what the JSON schema says of them.

`model` has the keys. A value that does not fit raises UnfitError, whose sentence `draft` turns into a finding.
"""

import math
from collections.abc import Callable, Mapping
from decimal import Decimal
from fractions import Fraction
from typing import Annotated, Any, Final, Literal

from heronry_dg import quantities
from heronry_dg.findings import shown
from heronry_dg.keys import Bounds, Reading
from heronry_dg.quantities import UnfitError
from heronry_dg.rules import schema as rules
from heronry_wire.canaerospace import DataType
from heronry_wire.management import MOST_PRIORITY

NAME_PATTERN: Final = "[A-Za-z][A-Za-z0-9_]{0,63}"  # valid in C and DBC; without '=' and '%', as in pe:NAME=40%
DEFAULT_PHASE: Final = "default"
MOST_VERSIONS: Final = 15  # a version takes four bits of the frame's service code
MOST_RESTARTS: Final = 10  # the delay before a restart doubles each time
MOST_POINTS: Final = 1_000_000  # of a priority, a value, a worth: sums of their products stay inside 64 bits


CRITICALITIES = ("A", "B", "C", "D", "E")
Criticality = Literal["A", "B", "C", "D", "E"]


def _number(convert: Callable[[object], Any], description: str, parts: int = 1) -> Reading:
    return Reading(convert, schema={"type": "number", "minimum": 0, "description": description}, parts=parts)


def _memory(convert: Callable[[object], int]) -> Reading:
    text = {"type": "string", "pattern": r"^[0-9]+(\.[0-9]+)?(KiB|MiB|GiB)$"}
    return Reading(convert, schema={"anyOf": [{"type": "integer", "minimum": 0}, text]}, in_bytes=True)


def _by_phase(one: dict[str, Any]) -> Reading:
    by_phase = {"type": "object", "additionalProperties": one, "required": [DEFAULT_PHASE]}
    return Reading(before=_for_all_phases, after=_with_default, schema={"anyOf": [one, by_phase]}, in_any_order=True)


def _different(names: list[str]) -> list[str]:
    if len(set(names)) == len(names):
        return names
    twice = next(name for position, name in enumerate(names) if name in names[:position])
    raise UnfitError(rules.LISTED_TWICE, f"names {shown(twice)} twice", "remove one of them")


def _for_all_phases(value: object) -> object:
    return value if isinstance(value, dict) else {DEFAULT_PHASE: value}


def _with_default(by_phase: dict[str, Any]) -> dict[str | None, Any]:
    """Convert the keys of a map by phase: `default`, which stands for all phases without a key, becomes None."""
    if DEFAULT_PHASE not in by_phase:
        hint = f"add '{DEFAULT_PHASE}', with the value for all other phases"
        raise UnfitError(rules.NO_DEFAULT, f"gives no '{DEFAULT_PHASE}'", hint)
    return {None if phase == DEFAULT_PHASE else phase: value for phase, value in by_phase.items()}


def _checkpoint(value: object) -> object:
    if isinstance(value, dict):
        return value
    sentence = f"must say how the state is kept, not {shown(value)}"
    raise UnfitError(rules.NOT_A_MAP, sentence, "write checkpoint: {bytes: 64, hz: 5, max_age_ms: 1000}")


def _priority_range(value: object) -> tuple[int, int]:
    match value:
        case [int(low), int(high)] if bool not in (type(low), type(high)) and 0 <= low <= high <= MOST_PRIORITY:
            return low, high
        case _:
            pass
    sentence = f"must be a list of two whole numbers from 0 to {MOST_PRIORITY}: the lowest priority, then the highest"
    raise UnfitError(rules.WRONG_TYPE, sentence, "write priority_range: [0, 100]")


def _identifier_range(value: object) -> tuple[int, int]:
    match value:
        case [int(first), int(last)] if bool not in (type(first), type(last)) and first >= 0:
            if first > last:
                hint = f"write range: [{last}, {first}]"
                raise UnfitError(rules.REVERSED_RANGE, f"is reversed: {first} is more than {last}", hint)
            return first, last
        case _:
            pass
    sentence = "must be a list of two whole numbers, 0 or more: the first identifier, then the last"
    raise UnfitError(rules.WRONG_TYPE, sentence, "write range: [1800, 1815]")


def _number_range(value: object) -> tuple[Fraction, Fraction]:
    if not isinstance(value, list) or len(value) != 2:
        sentence = f"must be a list of two numbers, the least and the largest, not {shown(value)}"
        raise UnfitError(rules.WRONG_TYPE, sentence, "write [-25, 25]")
    low, high = (quantities.number(one) for one in value)
    if low >= high:
        hint = f"write [{value[1]}, {value[0]}]" if low > high else "write the least number first, then a larger one"
        raise UnfitError(rules.REVERSED_RANGE, f"holds nothing: {value[0]} is not less than {value[1]}", hint)
    return low, high


def _positive_number(value: object) -> Fraction:
    exact = quantities.number(value)
    if exact <= 0:
        raise UnfitError(rules.OUT_OF_RANGE, f"must be more than 0, not {value}", "write a number such as 60")
    return exact


def _safe_action(value: object) -> str | Fraction:
    if value in ("hold", "release"):
        return str(value)
    if isinstance(value, str):
        sentence = f"must be 'hold', 'release' or a number, not {shown(value)}"
        raise UnfitError(rules.NOT_A_CHOICE, sentence, "write safe: release")
    return quantities.number(value)


def _options(value: object) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise UnfitError(rules.NOT_A_MAP, f"must be a map, not {shown(value)}", "write options: {bus: 1}")
    return {name: _option(name, one) for name, one in value.items()}


def _option(name: str, value: object) -> Any:
    match value:
        case bool() | str() | int():
            return value
        case Decimal():
            return float(value)
        case float() if math.isfinite(value):
            return value
        case list() if value and all(type(item) in (int, float, Decimal) for item in value):
            return tuple(float(item) if isinstance(item, Decimal) else item for item in value)
        case _:
            pass
    sentence = f"gives {shown(name)} the value {shown(value)}, which is no number, text, true, false or list of numbers"
    raise UnfitError(rules.WRONG_TYPE, sentence, "write one of these")


def _optional_number(value: object) -> Fraction | None:
    return None if value is None else quantities.number(value)


Unread: Final = Reading(convert=lambda value: value)  # as the file has it: another stage of the loader reads it
Cpu = Annotated[int, _number(quantities.cpu_millis, "reference cores, to a thousandth", parts=1000)]
Capacity = Annotated[int, _number(quantities.positive_cpu_millis, "reference cores, to a thousandth", parts=1000)]
Memory = Annotated[int, _memory(quantities.memory_bytes)]
PositiveMemory = Annotated[int, _memory(quantities.positive_memory_bytes)]
Rate = Annotated[int, _number(quantities.rate_mhz, "Hz, to a thousandth", parts=1000)]
Period = Annotated[int, _number(quantities.period_ns, "ms, to a nanosecond", parts=1_000_000)]
Span = Annotated[int, _number(quantities.span_ns, "ms, to a nanosecond", parts=1_000_000)]
Share = Annotated[Fraction, _number(quantities.share, "a share, 0 to 1")]
Probability = Annotated[Fraction, _number(quantities.probability, "from 0 to 1")]
Part = Annotated[Fraction, _number(quantities.part, "above 0, at most 1")]
Hours = Annotated[Fraction, _number(quantities.hours, "hours, more than 0")]
FailureRate = Annotated[Fraction, _number(quantities.failures_per_hour, "failures per hour")]
Threshold = Annotated[Fraction | None, Reading(_optional_number, schema={"type": "number"})]
Names = Annotated[tuple[str, ...], Reading(after=_different, marks={"uniqueItems": True})]
Labels = Annotated[frozenset[str], Reading(after=_different, marks={"uniqueItems": True})]
Version = Annotated[int, Bounds(ge=1)]
PriorityRange = Annotated[
    tuple[int, int],
    Reading(
        _priority_range,
        schema={
            "type": "array",
            "items": {"type": "integer", "minimum": 0, "maximum": MOST_PRIORITY},
            "minItems": 2,
            "maxItems": 2,
        },
    ),
]
IdentifierRange = Annotated[
    tuple[int, int],
    Reading(
        _identifier_range,
        schema={"type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 2, "maxItems": 2},
    ),
]
_NUMBER_PAIR = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
NumberRange = Annotated[tuple[Fraction, Fraction], Reading(_number_range, schema=_NUMBER_PAIR)]
PositiveNumber = Annotated[Fraction, Reading(_positive_number, schema={"type": "number", "exclusiveMinimum": 0})]
SafeAction = Annotated[
    str | Fraction,
    Reading(_safe_action, schema={"anyOf": [{"enum": ["hold", "release"]}, {"type": "number"}]}),
]
DriverName = Annotated[str, Bounds(pattern=r"^[A-Za-z_][A-Za-z0-9_.-]*(:[A-Za-z_][A-Za-z0-9_]*)?$", max_length=128)]
Options = Annotated[Mapping[str, Any], Reading(_options, schema={"type": "object"}, in_any_order=True)]
Restarts = Annotated[int, Bounds(ge=0, le=MOST_RESTARTS)]
Points = Annotated[int, Bounds(ge=0, le=MOST_POINTS)]
Name = Annotated[str, Bounds(pattern=f"^{NAME_PATTERN}$")]
PrintableText = Annotated[str, Bounds(min_length=1, max_length=64, pattern=r'^[^\x00-\x1f\x7f"\\]*$')]
MapOfCheckpoint: Final = Reading(before=_checkpoint)  # so that the finding shows all three keys
CriticalityByPhase = Annotated[Mapping[str | None, Criticality], _by_phase({"enum": list(CRITICALITIES)})]
PriorityByPhase = Annotated[
    Mapping[str | None, Points], _by_phase({"type": "integer", "minimum": 0, "maximum": MOST_POINTS})
]
DataTypeName = Annotated[str, Reading(schema={"enum": [data_type.name for data_type in DataType]})]
Initial = Annotated[int | float | str | tuple[int, ...] | None, Unread]  # `initial_value`, which needs the data type
