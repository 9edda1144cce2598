"""The one stream of events: every kind as a line and back, damaged lines, and the schema."""

import json
import random
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Any, get_type_hints

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.plan_report import LevelReport
from heronry_manager import events
from heronry_manager.events import KINDS, VERSION
from heronry_manager.events.line import to_line, to_object
from heronry_manager.events.reading import events_in, read_event
from heronry_manager.events.schema import SCHEMA_FILE, schema_text
from heronry_tools.cli import main
from heronry_wire.frame import Malformed

SCHEMA = json.loads(SCHEMA_FILE.read_text())
EVERY_KIND = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def drawn(hint: Any, chance: random.Random) -> Any:
    """Return a value of an annotation, such as a field of an event has."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return drawn(chance.choice(inner), chance)
    if origin is typing.Literal:
        return chance.choice(inner)
    if origin is tuple and inner[-1] is Ellipsis:
        return tuple(drawn(inner[0], chance) for _ in range(chance.randrange(3)))
    if origin is tuple:
        return tuple(drawn(one, chance) for one in inner)
    if origin is Mapping:
        return {drawn(inner[0], chance): drawn(inner[1], chance) for _ in range(chance.randrange(3))}
    if is_dataclass(hint):
        return made(hint, chance)
    plain = {
        int: chance.randrange(-3, 1 << 40),
        bool: chance.random() < 0.5,
        float: chance.random(),
        Any: [1, {"a": None}],
    }
    return {**plain, str: chance.choice(["", "nav", "é", '"']), types.NoneType: None}[hint]


def made(kind: Any, chance: random.Random) -> Any:
    hints = get_type_hints(kind)
    return kind(**{one.name: drawn(hints[one.name], chance) for one in fields(kind)})


@EVERY_KIND
def test_an_event_is_read_again_as_it_was_written_and_fits_the_schema(kind: type[events.Event]) -> None:
    schema, chance = {"$ref": f"#/$defs/{kind.__name__}", "$defs": SCHEMA["$defs"]}, random.Random(kind.KIND)
    fits = jsonschema.Draft202012Validator(schema)
    for _ in range(5):
        event = made(kind, chance)
        line = to_line(event)
        assert read_event(line) == event == read_event(line.encode())
        assert to_line(read_event(line)) == line
        assert json.loads(line) == to_object(event)
        fits.validate(json.loads(line))


@EVERY_KIND
def test_a_line_has_version_time_kind_and_the_fields_in_their_order(kind: type[events.Event]) -> None:
    event = made(kind, random.Random(1))
    own = {one.name: one.default for one in fields(kind) if one.default is not MISSING}
    left_out = {name for name, default in own.items() if getattr(event, name) == default}
    names = [one.name for one in fields(kind) if one.name not in {"t_ns", *left_out}]
    assert list(json.loads(to_line(event))) == ["v", "t_ns", "event", *names]


def test_a_field_with_a_default_is_in_the_line_only_where_it_has_another_value() -> None:
    lost = events.PeLost(5, "nav", "silent", None)
    assert to_line(lost) == '{"v":1,"t_ns":5,"event":"pe_lost","pe":"nav","cause":"silent","last_heard_ns":null}'
    waited = replace(lost, waited=events.Waited("pe:nav", 1, 2))
    assert to_line(waited).endswith('"last_heard_ns":null,"waited":{"who":"pe:nav","for_ns":1,"of_ns":2}}')
    assert [read_event(to_line(one)) for one in (lost, waited)] == [lost, waited]


def test_a_kind_has_the_name_of_its_class() -> None:
    assert events.PeLost.KIND == "pe_lost"
    assert events.Bus.KIND == "bus"
    assert KINDS["epoch_seen"] is events.EpochSeen


@EVERY_KIND
def test_an_event_says_what_it_tells(kind: type[events.Event]) -> None:
    assert kind.__doc__ is not None
    assert kind.__doc__.endswith(".")
    assert "\n" not in kind.__doc__


# Lines from elsewhere


def test_an_unknown_kind_is_kept_as_it_is() -> None:
    line = '{"v":2,"t_ns":1,"event":"landed","where":"sea"}'
    event = read_event(line)
    assert event == events.UnknownEvent(1, "landed", {"where": "sea"})
    assert event.kind == "landed"
    assert json.loads(to_line(event)) == {**json.loads(line), "v": VERSION}


def test_a_field_of_a_later_version_is_left_out() -> None:
    assert read_event('{"v":2,"t_ns":1,"event":"refused","term":3,"why":"x"}') == events.Refused(1, 3)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("", "the line is not JSON"),
        ('{"t_ns":', "the line is not JSON"),
        (b"\xff", "the line is not JSON"),
        ("[" * 100_000, "the line is not JSON"),
        (f'{{"event":"refused","t_ns":{1 << 63}}}', "the line has a number that is too large"),
        (f'{{"event":"refused","t_ns":{"9" * 5000}}}', "the line has a number that is too large"),
        ('{"event":"refused","t_ns":1,"x":1e999}', "the line has a number that is too large"),
        ('{"event":"refused","t_ns":1,"x":NaN}', "the line has a number that is too large"),
        ("[1]", "the line is no JSON object"),
        ("{}", "the line names no kind of event ('event')"),
        ('{"event":["refused"],"t_ns":1}', "the line names no kind of event ('event')"),
        ('{"event":"refused","term":1}', "event refused: 't_ns' is no time in whole nanoseconds"),
        ('{"event":"refused","term":1,"t_ns":true}', "event refused: 't_ns' is no time in whole nanoseconds"),
        ('{"event":"refused","term":1,"t_ns":1.5}', "event refused: 't_ns' is no time in whole nanoseconds"),
        ('{"event":"refused","t_ns":1}', "event refused: 'term' is missing"),
        ('{"event":"refused","t_ns":1,"term":"1"}', "event refused: 'term': input should be a valid integer"),
        (
            '{"event":"epoch_seen","t_ns":1,"epoch":1,"plan":null,"began_ns":1,"times_ns":{"detect":1}}',
            "event epoch_seen: 'times_ns.decide' is missing",
        ),
        ('{"event":"runs","t_ns":1,"epoch":1,"plan":{"modules":{"a":{"pe":1}}}}', "event runs: 'plan.spec' is missing"),
    ],
)
def test_a_damaged_line_is_reported_in_one_sentence(line: str | bytes, reason: str) -> None:
    assert read_event(line) == Malformed(reason)


@given(st.integers(0, len(KINDS) - 1), st.integers(0, 400), st.binary(max_size=6), st.integers(0, 6))
def test_no_damage_raises_anything(number: int, place: int, put: bytes, over: int) -> None:
    line = to_line(made(list(KINDS.values())[number], random.Random(number))).encode()
    read_event(line[:place] + put + line[place + over :])


def test_lines_that_hold_no_event_are_left_out() -> None:
    assert list(events_in(["{}", to_line(events.Refused(1, 2)), "end"])) == [events.Refused(1, 2)]


# What the classes are for others


def test_the_file_of_the_schema_is_that_of_this_version(capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA_FILE.read_text() == schema_text(), f"write it anew: heronry schema events > {SCHEMA_FILE}"
    assert main(["schema", "events"]) == 0
    assert capsys.readouterr().out == schema_text()


def test_the_schema_describes_nested_records_once() -> None:
    assert set(SCHEMA["$defs"]["PeLost"]["required"]) == {"v", "t_ns", "event", "pe", "cause", "last_heard_ns"}
    assert SCHEMA["$defs"]["Times"]["properties"].keys() == {"detect", "decide", "distribute", "activate"}
    assert SCHEMA["$defs"][LevelReport.__name__]["required"] == ["level", "value", "bound", "proven"]
