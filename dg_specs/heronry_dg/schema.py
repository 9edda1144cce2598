"""The forms of a spec: pydantic models that check each element by itself, made from the keys that `model` declares.

The JSON schema is generated from the same forms. Whether names refer to something is checked by reference_rules.py.

Only one key is declared here: `modes`, since a module may be written in two ways, with it or with the keys of a mode.
"""

from collections import abc
from collections.abc import Iterator, Mapping
from functools import cache, partial, reduce
from operator import or_
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    WithJsonSchema,
    create_model,
    model_validator,
)

from heronry_dg.keys import LISTS, REQUIRED, Bounds, DeclaredKey, Reading, is_element, keys_of, stand_ins
from heronry_dg.model import Mode, Module, Spec

ONLY_MODE: Final = "only"

E = TypeVar("E")


class Form(BaseModel):
    """Base of all forms: no unknown keys, no conversion of types; a key without a value counts as left out."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _leave_out_nothing(cls, fields: object) -> object:
        if isinstance(fields, dict) and None in fields.values():
            return {key: value for key, value in fields.items() if value is not None or key not in field_names(cls)}
        return fields


@cache
def field_names(form: type[Form]) -> frozenset[str]:
    """Return the names of a form's fields, as the file spells them."""
    return frozenset(field.alias or name for name, field in form.model_fields.items())


@cache
def form_of(element: Any) -> type[Form]:
    """Return the form of a kind of element, which is a dataclass of the model."""
    return _form(f"{element.__name__}Form", element.__doc__, _fields(element))


@cache
def module_forms() -> tuple[type[Form], type[Form]]:
    """Return the forms of a whole module: of one that lists its modes, and of one with a single mode."""
    module, mode = form_of(Module), form_of(Mode)
    modes = Field(
        min_length=1,
        description="Modes by name, best first.",
        examples=[{"fused": {"needs": "altitude", "cpu": 0.1, "ram": "2KiB", "rate_hz": 10}}],
    )
    several = {"modes": (dict[str, mode], modes)}  # type: ignore[valid-type]
    meaning = "A module with a single mode, named `only`; the fields of this mode are written at the module itself."
    return (
        _form("ModuleOfModesForm", "A module that lists its modes.", several, module),
        _form("ModuleOfOneModeForm", meaning, {}, module, mode),
    )


@cache
def spec_form() -> type[Form]:
    """Return the form of a whole file."""
    fields = _fields(Spec)
    several, single = module_forms()
    fields["modules"] = (dict[str, several | single], fields["modules"][1])  # type: ignore[valid-type]
    fields["demuxes"] = (dict[str, Any], fields["demuxes"][1])  # an expression may stand for a DEMUX
    return _form("SpecForm", Spec.__doc__, fields)


def read(element: type[E], fields: object, found: Mapping[str, object]) -> E:
    """Read the keys of an element; raises pydantic's ValidationError.

    fields: the keys and their values, as the file has them.
    found: fields of the element that are no keys, such as its name.
    """
    kind: Any = element
    whole: E = _element(kind, form_of(kind).model_validate(fields), found)
    return whole


def _element(element: Any, form: Form, found: Mapping[str, object] = MappingProxyType({})) -> Any:
    return element(**{**stand_ins(element), **found, **vars(form)})


def _form(name: str, meaning: str | None, fields: Mapping[str, Any], *bases: type[Form]) -> type[Form]:
    form: type[Form] = create_model(name, __base__=bases or Form, __doc__=meaning, **fields)
    return form


def _fields(element: type) -> dict[str, Any]:
    return {one.field: (_field_type(one), _field(one)) for one in keys_of(element)}


def _field(one: DeclaredKey) -> Any:
    about: dict[str, Any] = {"alias": one.key.called, "description": one.key.meaning, "examples": [*one.key.examples]}
    if one.default is not REQUIRED:
        about |= {"default": one.default, "json_schema_extra": {"default": one.written(one.default)}}
    return Field(**about)


def _field_type(one: DeclaredKey) -> Any:
    return _type(one.type) | None if one.is_resolved else _type(one.type)


def _type(annotation: Any) -> Any:
    """Return the type of a form for a type of the model: the file has a list for a tuple, and a map for an element."""
    base: Any
    base, *marks = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    checks = [check for mark in marks for check in _checks(mark)]
    if any(isinstance(mark, Reading) and mark.convert is not None for mark in marks):
        return Annotated[(Any, *checks)]
    origin, inside = get_origin(base), get_args(base)
    form = base
    if origin in LISTS:
        form, checks = list[_type(inside[0])], [*checks, AfterValidator(origin)]  # type: ignore[misc]
    elif origin is abc.Mapping:
        form = dict[str, _type(inside[1])]  # type: ignore[misc]
    elif origin in (UnionType, Union):
        form = reduce(or_, map(_type, inside))
    elif is_element(base):
        form, checks = form_of(base), [*checks, AfterValidator(partial(_element, base))]
    return Annotated[(form, *checks)] if checks else form


def _checks(mark: object) -> Iterator[Any]:
    """Yield what pydantic knows a mark of a type as."""
    match mark:
        case Bounds():
            bounds = {name: getattr(mark, name) for name in mark.__slots__}
            yield Field(**{name: bound for name, bound in bounds.items() if bound is not None})
        case Reading():
            if mark.before is not None:
                yield BeforeValidator(mark.before)
            if mark.convert is not None:
                yield PlainValidator(mark.convert)
            if mark.after is not None:
                yield AfterValidator(mark.after)
            if mark.schema is not None:
                yield WithJsonSchema(dict(mark.schema))
            if mark.marks is not None:
                yield Field(json_schema_extra=dict(mark.marks))
        case _:
            pass
