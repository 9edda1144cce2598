"""Events of a manager's process, read from a real pipe."""

import os

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events import PeLost, PlanKept
from heronry_manager.events.line import to_line
from heronry_tools.runtime.demo import awaited_events
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)


def test_an_event_is_given_when_its_line_is_whole_and_the_end_is_noticed() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe:
        stream = EventStream(pipe)
        assert stream.take() == []
        lines = [to_line(PlanKept(1, number)).encode() + b"\n" for number in range(3)]
        os.write(writing, lines[0] + b"no event\n" + lines[1] + lines[2][:5])
        assert stream.take() == [PlanKept(1, 0), PlanKept(1, 1)]
        assert stream.take() == []
        os.write(writing, lines[2][5:])
        assert stream.take(wait_s=10) == [PlanKept(1, 2)]
        assert not stream.has_ended
        os.close(writing)
        assert stream.take(wait_s=10) == []
        assert stream.has_ended


def test_a_waiting_caller_gets_the_event_that_is_meant_and_ends_with_the_manager() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe, Fleet(SPEC, FILE, run_folder()) as fleet:
        events = AwaitedEvents(fleet, pipe)
        told = [PeLost(1, "a", "silent", None), PeLost(1, "b", "silent", None), PlanKept(2, 1)]
        os.write(writing, "".join(to_line(one) + "\n" for one in told).encode())
        assert events.wait(PeLost, pe="b") == told[1]
        assert events.take() == [told[2]]
        os.close(writing)
        with pytest.raises(SystemExit, match="a manager has closed its output of events; repeat the benchmark"):
            events.wait(PlanKept)


def test_an_event_that_does_not_come_ends_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(awaited_events, "LONGEST_S", 0.0)
    reading, writing = os.pipe()
    with (
        os.fdopen(reading, "rb") as pipe,
        os.fdopen(writing, "wb"),
        Fleet(SPEC, FILE, run_folder()) as fleet,
        pytest.raises(SystemExit, match="no event 'plan_kept' or 'pe_lost' came in 0 s; the last event was 'nothing'"),
    ):
        AwaitedEvents(fleet, pipe).wait(PlanKept, PeLost)
