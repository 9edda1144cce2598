"""How a key of a spec is declared: once, as a field of a dataclass of `model`.

    restarts: Annotated[Restarts, Key("How many times the PE restarts a failed module.", 0)] = 2

This line is all that a key needs. From it come the form that reads the file and refuses what does not fit (`schema`),
the JSON schema, the row of docs/semantics.md, the attribute of the model and its default, and the key's name and unit
in `heronry diff`. A type is one of `field_types`, a choice (`Literal`), or one of these:

    tuple[X, ...], frozenset[X]     a list in the file
    Mapping[str, X]                 a map by name
    a dataclass with keys           a map with these keys; it can be X, too

A field without a `Key`, such as the name of an element, comes from elsewhere in the file. When all elements have been
read, the loader fills in the fields marked `Found`, and keys with `resolved` that were left out.

This file imports nothing that a PE would not have.
"""

from collections import abc
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from fractions import Fraction
from functools import cache
from typing import Annotated, Any, Final, get_args, get_origin, get_type_hints

LISTS: Final = (tuple, frozenset)
LISTS_AND_MAPS: Final = (*LISTS, abc.Mapping)
REQUIRED: Final = MISSING  # in place of a default: the file must give the key


class Key:
    """What a key means, and what counts if the file leaves it out."""

    __slots__ = ("analysis_only", "called", "examples", "left_out", "meaning", "repeats", "required", "resolved")

    def __init__(
        self,
        meaning: str,
        *examples: object,
        called: str | None = None,
        left_out: object = MISSING,
        resolved: object = MISSING,
        required: bool = False,
        analysis_only: bool = False,
        repeats: bool = False,
    ) -> None:
        """Declare a key.

        meaning: one or two sentences for the documents.
        examples: values as the file has them, at least one.
        called: name of the key in the file, if the attribute of the model is called otherwise.
        left_out: the default, in the units of the model, of a field that cannot have one (one with a default may not
        come before one without).
        resolved: what stands in a draft where the key is left out, until the loader has found the value in other
        elements.
        required: True if the file must give the key although the field has a default.
        analysis_only: True if the key changes no plan, table or flight, so that the digest of a spec does not tell it
        (`meaning`).
        repeats: True if other fields of the model say the same, so that the digest need not tell it again.
        """
        self.meaning, self.examples, self.called = meaning, examples, called
        self.left_out, self.resolved, self.required = left_out, resolved, required
        self.analysis_only, self.repeats = analysis_only, repeats


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Mark of a field that is no key: the loader finds its value in other elements."""

    until_then: object  # stands in a draft


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """How the value of a key is read; part of the key's type, as are `Bounds`.

    A function raises UnfitError for a value that does not fit.
    """

    convert: Callable[[object], Any] | None = None  # reads the value alone; what the type says is for mypy
    before: Callable[[object], object] | None = None  # prepares the value for the type
    after: Callable[[Any], Any] | None = None  # checks or converts what the type has let through
    schema: Mapping[str, Any] | None = None  # JSON schema, in place of that of the type
    marks: Mapping[str, Any] | None = None  # additions to the JSON schema of the type
    parts: int = 1  # units of the model in one of the file
    in_bytes: bool = False  # a size of memory, such as 64KiB
    in_any_order: bool = False  # a map whose order has no meaning


@dataclass(frozen=True, slots=True)
class Bounds:
    """The least and the most that a number, the length of a text or the number of items may be."""

    gt: int | None = None
    ge: int | None = None
    le: int | None = None
    min_length: int | None = None
    max_length: int | None = None
    pattern: str | None = None


@dataclass(frozen=True, slots=True)
class DeclaredKey:
    """A key with its field in the model."""

    field: str  # name of the attribute
    name: str  # in the file
    key: Key
    type: Any  # with `Reading` and `Bounds`
    default: Any  # in the units of the model; REQUIRED if there is none
    inherited: bool  # whether elements of several kinds have the key

    @property
    def is_resolved(self) -> bool:
        """Whether other elements decide what counts if the key is left out."""
        return self.key.resolved is not MISSING

    @property
    def reading(self) -> Reading:
        """How the value is read; an empty `Reading` if the type alone says it."""
        return next((mark for mark in _marks(self.type) if isinstance(mark, Reading)), Reading())

    def in_units_of_the_file(self, value: object) -> Any:
        """Return a value of the model with quantities, which may be its items, in the units of the file."""
        return _divided(value, self.reading.parts) if self.reading.parts > 1 else value

    def written(self, value: object) -> Any:
        """Return a value of the model as JSON would have it in a file."""
        if self.is_resolved and value == self.key.resolved:
            return None
        return _written(self.in_units_of_the_file(value))


@cache
def keys_of(element: Any) -> tuple[DeclaredKey, ...]:
    """Return the keys of a kind of element, which is a dataclass of the model; those of its base class come first."""
    hints = get_type_hints(element, include_extras=True)
    return tuple(
        DeclaredKey(
            field=field.name,
            name=key.called or field.name,
            key=key,
            type=hints[field.name],
            default=_default(key, field.default, field.default_factory),
            inherited=field.name not in element.__annotations__,
        )
        for field in fields(element)
        for key in get_args(hints[field.name])[1:]
        if isinstance(key, Key)
    )


@cache
def key_names(element: type) -> tuple[str, ...]:
    """Return the names of the keys of a kind of element, as the file spells them."""
    return tuple(one.name for one in keys_of(element))


def element_at(annotation: Any, path: Sequence[int | str]) -> type:
    """Return the kind of element that a value in an element of the file is, such as `When` at `when` of a phase.

    annotation: the kind of the outer element.
    path: keys, names and positions in lists that lead to the inner element; (): the outer element itself.
    """
    if is_element(annotation):
        found: type = annotation
        types = {one.name: one.type for one in keys_of(found)}
        return element_at(types[str(path[0])], path[1:]) if path else found
    inside = next(one for one in _inside(annotation) if element_in(one) is not None)
    return element_at(inside, path[1:] if get_origin(annotation) in LISTS_AND_MAPS else path)


def element_in(annotation: Any) -> type | None:
    """Return the kind of element that the values of a type are or consist of; None if they are something else."""
    if is_element(annotation):
        found: type = annotation
        return found
    return next((one for one in map(element_in, _inside(annotation)) if one is not None), None)


def is_element(value: Any) -> bool:
    """Tell whether a type is a dataclass with keys."""
    kind: Any = value if is_dataclass(value) else object
    return kind is not object and bool(keys_of(kind))


@cache
def stand_ins(element: type) -> Mapping[str, Any]:
    """Return what a draft has in the fields that the loader will fill in from other elements, by name."""
    return {
        field: mark.until_then
        for field, hint in get_type_hints(element, include_extras=True).items()
        for mark in get_args(hint)[1:]
        if isinstance(mark, Found)
    }


def _default(key: Key, default: object, factory: Any) -> object:
    if key.required:
        return REQUIRED
    if key.resolved is not MISSING:
        return key.resolved
    if key.left_out is not MISSING:
        return key.left_out
    return default if factory is MISSING else factory()


def _inside(annotation: Any) -> tuple[Any, ...]:
    arguments = get_args(annotation)
    return arguments[:1] if get_origin(annotation) is Annotated else arguments


def _marks(annotation: Any) -> Iterator[object]:
    if get_origin(annotation) is Annotated:
        yield from get_args(annotation)[1:]
    for one in _inside(annotation):
        yield from _marks(one)


def _divided(value: object, parts: int) -> object:
    match value:
        case int():
            return Fraction(value, parts)
        case tuple():
            return tuple(_divided(one, parts) for one in value)
        case Mapping():
            return {name: _divided(one, parts) for name, one in value.items()}
        case _:
            return value


def _written(value: object) -> Any:
    match value:
        case Fraction():
            return _number(value)
        case Mapping() if list(value) == [None]:
            return _written(value[None])
        case Mapping():
            return {name: _written(one) for name, one in value.items()}
        case tuple() | frozenset():
            return [_written(one) for one in value]
        case _ if is_dataclass(value):
            kind: Any = type(value)
            return {one.name: one.written(getattr(value, one.field)) for one in keys_of(kind)}
        case _:
            return value


def _number(exact: Fraction) -> int | float:
    return exact.numerator if exact.denominator == 1 else float(exact)
