"""Events of a manager's process, read from a real pipe."""

import os

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.runtime.demo import awaited_events
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)


def test_an_event_is_given_when_its_line_is_whole_and_the_end_is_noticed() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe:
        events = EventStream(pipe)
        assert events.take() == []
        os.write(writing, b'{"event": "one"}\n{"event": "two"}\n{"eve')
        assert events.take() == [{"event": "one"}, {"event": "two"}]
        assert events.take() == []
        os.write(writing, b'nt": "three"}\n')
        assert events.take(wait_s=10) == [{"event": "three"}]
        assert not events.has_ended
        os.close(writing)
        assert events.take(wait_s=10) == []
        assert events.has_ended


def test_a_waiting_caller_gets_the_event_that_is_meant_and_ends_with_the_manager() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe, Fleet(SPEC, FILE, run_folder()) as fleet:
        events = AwaitedEvents(fleet, pipe)
        os.write(writing, b'{"event": "lost", "pe": "a"}\n{"event": "lost", "pe": "b"}\n{"event": "done"}\n')
        assert events.wait("lost", pe="b") == {"event": "lost", "pe": "b"}
        assert events.take() == [{"event": "done"}]
        os.close(writing)
        with pytest.raises(SystemExit, match="a manager has closed its output of events; repeat the benchmark"):
            events.wait("done")


def test_an_event_that_does_not_come_ends_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(awaited_events, "LONGEST_S", 0.0)
    reading, writing = os.pipe()
    with (
        os.fdopen(reading, "rb") as pipe,
        os.fdopen(writing, "wb"),
        Fleet(SPEC, FILE, run_folder()) as fleet,
        pytest.raises(SystemExit, match="no event 'done' or 'idle' came in 0 s; the last event was 'nothing'"),
    ):
        AwaitedEvents(fleet, pipe).wait("done", "idle")
