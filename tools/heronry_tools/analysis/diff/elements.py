"""The changes between two specs, field by field: elements that were added, removed and changed.

Every element is turned into a flat map from field to text, and the two specs are compared map by map. Fields are named
by the keys of a spec, and have the units in which a spec is written. An element that was renamed appears as one removed
and one added.

The order of modes, of branches and of phases carries meaning, so each of these orders is a field. Changes in comments,
in the spelling of a shorthand, and in the order of other elements are not listed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from decimal import Decimal
from fractions import Fraction
from typing import Any, Literal

from heronry_dg.gates import Expression, Leaf, demux_at, leaves, words
from heronry_dg.keys import DeclaredKey, Reading, is_element, keys_of
from heronry_dg.model import Mode, Module, Spec
from heronry_tools.reports.render.build import accepted_versions

Fields = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class FieldChange:
    """One changed field.

    `old` is None if the old spec does not have the field; `new` is None if the new spec does not have it.
    """

    field: str
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True)
class ElementChange:
    """One element, `kind:name`, and its changed fields."""

    element: str
    change: Literal["added", "removed", "changed"]
    fields: tuple[FieldChange, ...]


def element_changes(old: Spec, new: Spec) -> tuple[ElementChange, ...]:
    """List every element that differs between two specs.

    The elements of the old spec come first, in its order; those that only the new spec has follow, in its order.
    """
    before, after = dict(_elements(old)), dict(_elements(new))
    return tuple(
        ElementChange(element, _change(element, before, after), changes)
        for element in {**before, **after}
        if (changes := tuple(_field_changes(before.get(element, {}), after.get(element, {}))))
        or (element in before) != (element in after)
    )


def _change(
    element: str, before: Mapping[str, Fields], after: Mapping[str, Fields]
) -> Literal["added", "removed", "changed"]:
    if element not in before:
        return "added"
    return "changed" if element in after else "removed"


def _field_changes(old: Fields, new: Fields) -> Iterator[FieldChange]:
    for field in {**old, **new}:
        rewritten = field.endswith("worth") and old.get(f"{field[:-5]}needs") != new.get(f"{field[:-5]}needs")
        if old.get(field) != new.get(field) and not rewritten:
            yield FieldChange(field, old.get(field), new.get(field))


def _elements(spec: Spec) -> Iterator[tuple[str, Fields]]:
    yield (
        "spec",
        {
            **_named("name", spec.name),
            **_named("phases", tuple(spec.phases)),
            **_named("separate", spec.separate),
            **_named("together", spec.together),
        },
    )
    yield "manager", _flat(spec.manager)
    yield "contingency", _flat(spec.contingency)
    for kind, elements in (
        ("bus", spec.buses),
        ("pe", spec.pes),
        ("device", spec.devices),
        ("variable", spec.variables),
    ):
        for name in elements:
            yield f"{kind}:{name}", _flat(elements[name])
    for name, demux in spec.demuxes.items():
        fields_of = {field: text for field, text in _flat(demux).items() if field != "variable"}
        yield f"demux:{name}", {"demux": expression_text(spec, demux.demand), **fields_of}
    for name, module in spec.modules.items():
        yield f"module:{name}", _module(spec, module)
    for name, function in spec.functions.items():
        yield f"function:{name}", _flat(function)
    for name, phase in spec.phases.items():
        yield f"phase:{name}", _flat(phase.when) if phase.when is not None else {}


def _module(spec: Spec, module: Module) -> Fields:
    found = {field: text for field, text in _flat(module).items() if (field, text) != ("image", module.name)}
    if len(module.modes) > 1:
        found["modes"] = ", ".join(module.modes)
    for mode in module.modes.values():
        prefix = f"modes.{mode.name}." if len(module.modes) > 1 else ""
        found |= {f"{prefix}{field}": text for field, text in _mode(spec, mode).items()}
    return found


def _mode(spec: Spec, mode: Mode) -> Fields:
    needs = expression_text(spec, mode.needs) if mode.needs is not None else None
    worth = "; ".join(
        f"{leaf.variable} {_text(leaf.worth)}" for _, leaf in leaves(mode.needs) if len(set(leaf.worth)) > 1
    )
    return {**_named("needs", needs), **_named("worth", worth or None), **_flat(mode)}


def _flat(element: object) -> Fields:
    """Return the fields of a model element as a spec writes them; the name and nested elements are left out."""
    kind: Any = type(element)
    declared = {one.field: one for one in keys_of(kind)}
    found: dict[str, str] = {}
    for field in sorted(fields(kind), key=lambda field: field.name in declared and declared[field.name].inherited):
        if field.name not in ("name", "modes", "needs", "outputs"):
            found |= _named(field.name, getattr(element, field.name), declared.get(field.name))
    return found


def _named(field: str, value: object, key: DeclaredKey | None = None) -> Fields:
    """Return a field as text, by the key that a spec uses for it; the map is empty if the field has no value."""
    if value is None or value in ((), frozenset(), {}):
        return {}
    reading = key.reading if key is not None else Reading()
    name = key.name if key is not None else field
    if isinstance(value, int) and reading.in_bytes:
        return {name: _bytes(value)}
    return {name: _text(key.in_units_of_the_file(value) if key is not None else value)}


def _text(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case Fraction():
            return f"{Decimal(value.numerator) / value.denominator:f}"
        case frozenset():
            return ", ".join(sorted(map(str, value)))
        case tuple():
            return f"[{', '.join(map(_text, value))}]"
        case Mapping():
            return ", ".join(_entry(key, one) for key, one in value.items())
        case _ if is_element(type(value)):
            return f"{{{_text(_flat(value))}}}"
        case _:
            return str(value)


def _entry(key: object, value: object) -> str:
    """Write one entry of `gives` or of a map by phase. A key None stands for the default: only its value is written."""
    return _text(value) if key is None else f"{key}: {_text(value)}"


def _bytes(count: int) -> str:
    for unit, size in (("MiB", 1 << 20), ("KiB", 1 << 10)):
        if count and count % size == 0:
            return f"{count // size}{unit}"
    return str(count)


def expression_text(spec: Spec, needs: Expression) -> str:
    """Write a gate expression in one line. An input that accepts only some versions is written with these versions."""
    if (demux := demux_at(needs)) is not None:
        return demux
    if isinstance(needs, Leaf):
        return f"{needs.variable}{accepted_versions(spec, needs)}"
    inputs = ", ".join(expression_text(spec, one) for one in needs.inputs)
    return f"{words(needs).written}({inputs})"
