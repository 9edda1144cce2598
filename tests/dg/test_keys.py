"""One line declares a key: its form, default, range, JSON schema, docs and text in a diff all come from that line.

The element of these tests has a key of every form that a type can have, elements inside elements included.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Annotated, Any, Literal

import pytest
from pydantic import ValidationError

from heronry_dg import model
from heronry_dg.field_types import Labels, Memory, Names, Period, Share
from heronry_dg.keys import Bounds, DeclaredKey, Found, Key, element_at, key_names, keys_of
from heronry_dg.loader import load
from heronry_dg.model import Bus, Fallible, Module, Pe
from heronry_dg.schema import form_of, read
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.analysis.diff.elements import element_changes


@dataclass(frozen=True, slots=True)
class Store:
    """Where a state is kept."""

    size: Annotated[Memory, Key("Size of the store.", "1KiB")]
    share: Annotated[Share, Key("Share in use.", 0.5)] = Fraction(1, 2)


@dataclass(frozen=True, slots=True)
class Recorder(Fallible):
    """A kind of element that no spec has."""

    name: str
    main: Annotated[Store, Key("The store.", {"size": 1})]
    heard: Annotated[Mapping[str, int], Found({})]
    bus: Annotated[str, Key("Bus; the first if left out.", "can0", resolved="")]
    spare: Annotated[Store | None, Key("A second store.", {"size": 1})] = None
    more: Annotated[tuple[Store, ...], Bounds(min_length=1), Key("More stores.", [{"size": 1}])] = ()
    named: Annotated[Mapping[str, Store] | None, Key("Stores by name.", {"size": {"size": 1}})] = None
    labels: Annotated[Labels, Key("Labels.", ["a"])] = frozenset({"a"})
    order: Annotated[Names, Key("Names.", ["a"], left_out=("b", "a"))] = ()
    period_ns: Annotated[Period, Key("Period in ms.", 20, called="period_ms")] = 12_500_000
    pauses_ns: Annotated[tuple[Period, ...], Key("Pauses in ms.", [1], called="pauses_ms")] = (1_500_000,)
    limits_ns: Annotated[
        Mapping[str, Period] | None, Key("Limits in ms.", {"a": 1}, called="limits_ms", left_out={"a": 2_000_000})
    ] = None
    kind: Annotated[Literal["ring", "log"], Key("Form of the store.", "ring")] = "ring"
    level: Annotated[int, Bounds(ge=1, le=9), Key("Level.", 1, required=True)] = 1


def test_what_the_file_leaves_out_has_its_default_or_what_stands_in_for_it() -> None:
    recorder = read(Recorder, {"main": {"size": 1}, "level": 2, "kind": None}, {"name": "r"})
    assert recorder == Recorder("r", Store(1), {}, "", order=("b", "a"), limits_ns={"a": 2_000_000}, level=2)


def test_what_the_file_gives_is_read_in_the_units_of_the_model_elements_in_elements_included() -> None:
    fields = {
        "main": {"size": "1KiB", "share": None},
        "spare": {"size": 2, "share": 1},
        "more": [{"size": 3}, {"size": 4}],
        "named": {"size": {"size": 5}},
        "labels": ["x", "y"],
        "order": ["x"],
        "period_ms": 20,
        "pauses_ms": [],
        "limits_ms": {"b": 3},
        "kind": "log",
        "level": 9,
        "bus": "can1",
        "rate_per_h": 1,
    }
    assert read(Recorder, fields, {"name": "r"}) == Recorder(
        "r",
        Store(1024),
        {},
        "can1",
        Store(2, Fraction(1)),
        (Store(3), Store(4)),
        {"size": Store(5)},
        frozenset({"x", "y"}),
        ("x",),
        20_000_000,
        (),
        {"b": 3_000_000},
        "log",
        9,
        rate_per_h=Fraction(1),
    )


MISTAKES: list[tuple[dict[str, Any], tuple[int | str, ...], str]] = [
    ({"main": {"size": 1}}, ("level",), "missing"),
    ({"main": {"size": 1}, "level": 10}, ("level",), "less_than_equal"),
    ({"main": {"size": 1}, "level": 1, "kind": "tape"}, ("kind",), "literal_error"),
    ({"main": {"size": 1}, "level": 1, "more": []}, ("more",), "too_short"),
    ({"main": {"size": -1}, "level": 1}, ("main", "size"), "value_error"),
    ({"main": {"size": 1}, "level": 1, "more": [{"size": 1}, {"site": 1}]}, ("more", 1, "size"), "missing"),
    ({"main": {"size": 1}, "level": 1, "named": {"a": {"size": 1, "b": 2}}}, ("named", "a", "b"), "extra_forbidden"),
    ({"main": {"size": 1}, "level": 1, "labels": ["a", "a"]}, ("labels",), "value_error"),
]


@pytest.mark.parametrize(("fields", "place", "kind"), MISTAKES, ids=str)
def test_what_does_not_fit_is_refused_at_its_place(
    fields: dict[str, Any], place: tuple[int | str, ...], kind: str
) -> None:
    with pytest.raises(ValidationError) as refused:
        read(Recorder, fields, {"name": "r"})
    errors = refused.value.errors()
    assert (errors[0]["loc"], errors[0]["type"]) == (place, kind)


def test_the_json_schema_has_names_defaults_and_ranges_as_a_file_has_them() -> None:
    schema = form_of(Recorder).model_json_schema()
    fields = schema["properties"]
    assert tuple(fields) == key_names(Recorder)
    assert schema["required"] == ["main", "level"]
    defaults = {name: field.get("default") for name, field in fields.items()}
    assert (defaults["period_ms"], defaults["labels"], defaults["order"]) == (12.5, ["a"], ["b", "a"])
    assert (defaults["pauses_ms"], defaults["limits_ms"]) == ([1.5], {"a": 2})
    assert (defaults["kind"], defaults["bus"], defaults["spare"]) == ("ring", None, None)
    assert (fields["level"]["minimum"], fields["level"]["maximum"]) == (1, 9)
    assert schema["$defs"]["StoreForm"]["properties"]["share"]["default"] == 0.5


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ((), Recorder),
        (("main",), Store),
        (("spare",), Store),
        (("more", 1), Store),
        (("named", "size"), Store),
    ],
    ids=str,
)
def test_a_misspelt_key_is_compared_with_the_keys_of_the_element_in_which_it_stands(
    path: tuple[int | str, ...], kind: type
) -> None:
    assert element_at(Recorder, path) is kind


def test_a_diff_names_keys_in_their_units_and_writes_elements_inside_elements() -> None:
    @dataclass(frozen=True, slots=True)
    class Recorded(Bus):
        stores: Annotated[tuple[Store, ...], Key("Stores.", [{"size": 1}])] = ()
        pause_ns: Annotated[Period, Key("Pause in ms.", 1, called="pause_ms")] = 1_000_000

    spec = load(shipped_spec_path("elevator_and_chute"))
    old = replace(spec, buses={"can0": Recorded("can0", 1_000_000)})
    stores = (Store(1024), Store(1, Fraction(1, 4)))
    new = replace(spec, buses={"can0": Recorded("can0", 1_000_000, stores=stores, pause_ns=2_500_000)})
    (change,) = element_changes(old, new)
    assert [(field.field, field.old, field.new) for field in change.fields] == [
        ("pause_ms", "1", "2.5"),
        ("stores", None, "[{size: 1KiB, share: 0.5}, {size: 1, share: 0.25}]"),
    ]


# The keys of specs

KINDS = [
    kind for kind in vars(model).values() if isinstance(kind, type) and kind.__module__.startswith(f"{model.__name__}.")
]
KEYS = [(kind, one) for kind in KINDS for one in keys_of(kind)]


@pytest.mark.parametrize(("kind", "one"), KEYS, ids=lambda part: getattr(part, "name", getattr(part, "__name__", "")))
def test_every_key_has_a_sentence_and_an_example(kind: type, one: DeclaredKey) -> None:
    assert one.key.meaning.endswith("."), kind
    assert one.key.examples, kind


def test_only_how_likely_things_fail_is_left_to_analysis() -> None:
    assert {one.field for _, one in KEYS if one.key.analysis_only} == {
        "rate_per_h",
        "probability",
        "common_cause",
        "mission_h",
    }
    assert [(kind.__name__, one.field) for kind, one in KEYS if one.key.repeats] == [("Demux", "needs")]
    assert {kind for kind, one in KEYS if one.field == "rate_per_h"} >= {Bus, Pe, Module}


@pytest.mark.parametrize("name", shipped_spec_names())
def test_no_spec_holds_what_stands_in_for_a_value_in_a_draft(name: str) -> None:
    spec = load(shipped_spec_path(name))
    assert spec.manager.bus in spec.buses
    assert all(module.image and module.modes for module in spec.modules.values())
    assert all(function.outputs for function in spec.functions.values())
    assert all(len(demux.branches) > 1 for demux in spec.demuxes.values())
    rules = {phase.name: phase.when for phase in list(spec.phases.values())[1:] if phase.when is not None}
    assert all(when.origins for when in rules.values())
