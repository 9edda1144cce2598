"""The format of a spec, from the schema that reads it: keys, their defaults, and limits."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any, Literal, get_args, get_origin

import yaml
from pydantic.fields import FieldInfo

from heronry_dg import expression_reader, quantities, reference_rules, schema, yaml_source
from heronry_dg.field_types import MOST_POINTS, MOST_VERSIONS, NAME_PATTERN
from lab.documents.markdown import code, table

_FORMS: dict[str, tuple[str, type[schema.Form]]] = {
    "the file itself": ("", schema.HeaderForm),
    "buses": ("one entry per CAN segment", schema.BusForm),
    "manager": ("where the managers sit", schema.ManagerForm),
    "pes": ("one entry per processing element", schema.PeForm),
    "devices": ("one entry per sensor or actuator", schema.DeviceForm),
    "variables": ("one entry per datum that modules exchange", schema.VariableForm),
    "gates": ("one entry per DEMUX; any other entry is a named expression (section 2)", schema.DemuxForm),
    "modules": ("one entry per module", schema.ModuleForm),
    "modules: modes": ("one entry per mode, best first", schema.ModeForm),
    "functions": ("one entry per system output", schema.FunctionForm),
    "phases": ("one entry per mission phase; the first is the initial one", schema.PhaseForm),
    "phases: when": ("exactly one of `above` and `below`", schema.WhenForm),
    "plants": ("one entry per part of the physical world; plans do not depend on them", schema.PlantForm),
    "contingency": ("what must be planned ahead", schema.ContingencyForm),
}
_OF_EVERY_KIND = "rate_per_h"


def keys() -> str:
    """Give one table per section of a spec: every key, its default, an example, its meaning."""
    parts = []
    for section, (what, form) in _FORMS.items():
        title = f"**{section}**" if not what else f"**`{section}`**: {what}"
        fields = sorted(form.model_fields.items(), key=lambda item: item[0] == _OF_EVERY_KIND)
        rows = [_row(field.alias or name, field) for name, field in fields]
        if form is schema.ModuleForm:
            rows.append(
                [
                    "`modes`",
                    "a single mode, `only`",
                    "",
                    "Its modes by name, best first; with one, its keys may stand here.",
                ]
            )
        parts.append(f"{title}\n\n" + table(["key", "if left out", "example", "meaning"], rows))
    return "\n\n".join(parts)


def limits() -> str:
    """Give the limits of a spec and of its numbers."""
    rows = [
        ("file", f"{yaml_source.MOST_BYTES} bytes"),
        ("values in the file", f"{yaml_source.MOST_NODES}"),
        ("nesting", f"{yaml_source.MOST_LEVELS} levels"),
        ("name", f"{code(NAME_PATTERN)}"),
        ("inputs of one gate, or of one mode, with named gates expanded", f"{expression_reader.MOST_LEAVES}"),
        ("inputs of all modes together", f"{expression_reader.MOST_LEAVES_OF_ALL}"),
        ("gates inside each other", f"{expression_reader.DEEPEST} levels"),
        ("versions of a variable", f"{MOST_VERSIONS}"),
        ("a priority, a value, a worth", f"{MOST_POINTS}"),
        ("CPU", f"{quantities.MOST_CORES} reference cores"),
        ("memory", f"{quantities.LARGEST_MEMORY >> 30} GiB"),
        ("rate", f"{quantities.MOST_HZ} Hz"),
        ("time", f"{quantities.MOST_MS} ms"),
        ("bit rate of a wired bus", f"{reference_rules.FASTEST_WIRE_BITS_PER_S} bit/s"),
    ]
    return table(["what", "at most"], rows)


def _row(key: str, field: FieldInfo) -> list[str]:
    example = code(_yaml(field.examples[0])) if field.examples else ""
    meaning = " ".join(filter(None, [field.description, _choices(field), _range(field)]))
    return [code(key), _default(field), example, meaning]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "must be given"
    if field.default in (None, [], {}):
        return ""
    value = float(field.default) if isinstance(field.default, Fraction) else field.default
    return code(value)


def _choices(field: FieldInfo) -> str:
    choices = [code(choice) for choice in _literals(field.annotation)]
    return f"One of {', '.join(choices)}." if len(choices) > 1 else ""


def _literals(annotation: Any) -> Iterator[object]:
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)


def _range(field: FieldInfo) -> str:
    bounds = [
        bound for mark in field.metadata for name in ("ge", "le") if (bound := getattr(mark, name, None)) is not None
    ]
    return f"From {bounds[0]} to {bounds[1]}." if len(bounds) == 2 else ""


def _yaml(value: object) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return text.removesuffix("\n").removesuffix("\n...")
