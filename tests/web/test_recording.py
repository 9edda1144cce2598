"""A recording at any moment is what its events up to then say."""

import asyncio
import json
from dataclasses import replace
from itertools import cycle, islice

import pytest

from heronry_manager.events import Adopted, Reconfigured
from heronry_manager.events.reading import events_in
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.changes import plain
from heronry_tools.web.live import Live
from heronry_tools.web.recording import Recording
from heronry_tools.web.stream import recorded_stream
from web.flight import S, big_blue, flown, load_line


@pytest.fixture(scope="module")
def reducer():
    return Reducer(big_blue())


@pytest.fixture(scope="module")
def recording(reducer):
    return Recording(reducer, list(flown()) * 4, "log")  # later copies have the times of the first one


def test_the_state_at_any_event_is_that_of_all_before_it(reducer, recording):
    events, truth, before = list(flown()) * 4, reducer.start("log"), 0
    for number in (0, 1, 57, 199, 200, 201, len(events)):
        truth = reducer.all(events[before:number], truth)
        assert recording.after(number).snapshot == truth.snapshot
        before = number


def test_going_on_from_a_known_state_gives_the_same(recording):
    early = recording.after(120)
    assert recording.after(160, early).snapshot == recording.after(160).snapshot
    assert recording.after(100, early).snapshot == recording.after(100).snapshot  # and back


def test_times_do_not_fall(recording):
    assert recording.times_ns == sorted(recording.times_ns)
    assert recording.events_until(recording.ends_ns) == len(recording.times_ns)


def test_loads_are_those_between_two_events(recording):
    until = recording.events_until(5 * S)
    assert [load["t_ns"] // S for load in recording.loads(0, until)] == [1, 2, 3, 4, 5]
    assert recording.loads(until, until) == []


def test_of_loads_that_are_told_twice_a_second_one_a_second_is_drawn(reducer):
    told = [replace(load_line(1), t_ns=half * S // 2) for half in range(8)]
    live = Live(reducer, "bus")
    live.take_all(told, None, is_alive=True)
    for loads in (live.loads(0), Recording(reducer, told, "log").loads(0, len(told))):
        assert [load["t_ns"] for load in loads] == [0, S, 2 * S, 3 * S]


def test_the_slider_has_a_mark_at_every_epoch_that_ran_adopted_ones_and_early_ones_too(reducer):
    many = [replace(one, epoch=number) for number, one in enumerate(islice(cycle(reconfigured()), 300), 1)]
    events = [replace(one, t_ns=number * S) for number, one in enumerate(many)]
    events.insert(150, Adopted(149 * S, epoch=1_000, digest="0000AB"))
    events.insert(152, Adopted(150 * S, epoch=150 + 1, digest="0000AB"))  # it is the last one already
    between = [[one, load_line(one.t_ns // S), load_line(one.t_ns // S)] for one in events]  # three events each
    recording = Recording(reducer, [one for three in between for one in three], "log")
    assert [mark["epoch"] for mark in recording.marks] == [*range(1, 151), 1_000, *range(151, 301)]
    assert [mark["t_ns"] // S for mark in recording.marks[149:152]] == [149, 149, 150]


def reconfigured():
    return [one for one in flown() if isinstance(one, Reconfigured)]


def test_a_recording_of_nothing_shows_nothing(reducer):
    empty = Recording(reducer, [], "log")
    assert (empty.begins_ns, empty.ends_ns, empty.first_configuration_ns, empty.marks) == (0, 0, 0, [])


def test_the_file_of_events_leaves_observations_out(recording):
    kinds = {one.kind for one in events_in(recording.lines())}
    assert "reconfigured" in kinds
    assert "bus_seen" not in kinds


def first_sent(stream, count):
    async def read():
        return [await anext(stream) for _ in range(count)]

    return asyncio.run(read())


def parsed(one):
    kind, data = one.strip().split("\n")
    return kind.removeprefix("event: "), json.loads(data.removeprefix("data: "))


def test_a_page_gets_the_moment_that_it_asked_for(recording):
    at_ns = recording.marks[1]["t_ns"]
    (kind, whole), (beat, told) = map(parsed, first_sent(recorded_stream(recording, at_ns, 0, asyncio.Event()), 2))
    assert kind == "whole"
    assert whole["snapshot"] == json.loads(json.dumps(plain(recording.after(recording.events_until(at_ns)).snapshot)))
    assert [mark["number"] for mark in whole["recording"]["marks"]] == [mark["number"] for mark in recording.marks]
    assert beat == "beat"
    assert not told["plays"]


def test_a_recording_that_plays_sends_what_comes(recording):
    stream = recorded_stream(recording, recording.begins_ns, 64.0, asyncio.Event())
    kinds = [parsed(one)[0] for one in first_sent(stream, 8)]
    assert kinds[0] == "whole"
    assert "change" in kinds


def test_a_stream_ends_with_its_server(recording):
    async def read():
        closing = asyncio.Event()
        stream = recorded_stream(recording, 0, 0, closing)
        first = await anext(stream)
        closing.set()
        return first, [one async for one in stream]

    first, rest = asyncio.run(read())
    assert first.startswith("event: whole")
    assert rest == []
