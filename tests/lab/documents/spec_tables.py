"""The format of a spec, from the schema that reads it: keys, their defaults, and limits."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal, get_args, get_origin

import yaml
from pydantic.fields import FieldInfo

from heronry_dg import expression_reader, model, quantities, reference_rules, schema, yaml_source
from heronry_dg.field_types import MOST_POINTS, MOST_VERSIONS, NAME_PATTERN
from heronry_dg.keys import REQUIRED, DeclaredKey, element_in, keys_of
from lab.documents.markdown import code, table

_KINDS: Final[Mapping[str, tuple[str, type]]] = {
    "the file itself": ("", model.Header),
    "buses": ("one entry per CAN segment", model.Bus),
    "manager": ("where the managers sit", model.Manager),
    "pes": ("one entry per processing element", model.Pe),
    "devices": ("one entry per sensor or actuator", model.Device),
    "variables": ("one entry per datum that modules exchange", model.Variable),
    "gates": ("one entry per DEMUX; any other entry is a named expression (section 2)", model.Demux),
    "modules": ("one entry per module", model.Module),
    "modules: modes": ("one entry per mode, best first", model.Mode),
    "functions": ("one entry per system output", model.Function),
    "phases": ("one entry per mission phase; the first is the initial one", model.Phase),
    "plants": ("one entry per part of the physical world; plans do not depend on them", model.Plant),
    "contingency": ("what must be planned ahead", model.Contingency),
}
_CONDITIONS: Final[Mapping[type, str]] = {
    model.When: f"exactly one of {' and '.join(f'`{name}`' for name in model.THRESHOLDS)}"
}
_MODES: Final = [
    "`modes`",
    "a single mode, `only`",
    "",
    "Its modes by name, best first; with one, its keys may stand here.",
]


def keys() -> str:
    """Return one table per section of a spec, and per element inside an element: every key with its default, an example
    and its meaning.
    """
    return "\n\n".join(part for section, (what, kind) in _KINDS.items() for part in _tables(section, what, kind))


def _tables(section: str, what: str, kind: type) -> Iterator[str]:
    title = f"**{section}**" if not what else f"**`{section}`**: {what}"
    declared = sorted(keys_of(kind), key=lambda one: one.inherited)
    fields = schema.form_of(kind).model_fields
    rows = [_row(one, fields[one.field]) for one in declared]
    yield f"{title}\n\n" + table(
        ["key", "if left out", "example", "meaning"], [*rows, _MODES] if kind is model.Module else rows
    )
    for one in declared:
        inner = element_in(one.type)
        if inner is not None:
            what = _CONDITIONS.get(inner, (inner.__doc__ or "").partition("\n")[0].rstrip("."))
            yield from _tables(f"{section}: {one.name}", what[:1].lower() + what[1:], inner)


def limits() -> str:
    """Return the limits of a spec and of its numbers."""
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


def _row(one: DeclaredKey, field: FieldInfo) -> list[str]:
    example = code(_yaml(field.examples[0])) if field.examples else ""
    meaning = " ".join(filter(None, [field.description, _choices(field), _range(field)]))
    return [code(one.name), _default(one), example, meaning]


def _default(one: DeclaredKey) -> str:
    if one.default is REQUIRED:
        return "must be given"
    written = one.written(one.default)
    return code(written) if written not in (None, [], {}) else ""


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
