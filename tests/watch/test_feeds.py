"""The feeds: a log tells causes where the manager's core decides again as recorded, a bus alone all but those."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from starlette.testclient import TestClient

from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events.line import to_line
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.sources.recordings import open_recording, tables_of
from heronry_tools.watch.listening import Listening
from heronry_tools.watch.metrics import exposition
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Snapshot, document
from heronry_tools.watch.timeline import Timeline
from heronry_tools.watch.top.sources import RecordedSource
from heronry_tools.web.app import Site, application
from heronry_tools.web.guard import Access
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording as WebRecording
from heronry_wire.frame import Frame, format_log_line
from watch.flights import ALL, DATE_NS, MS, big_blue, big_blue_log

pytestmark = pytest.mark.xdist_group("big_blue_log")  # it is flown once


def alone(recording: Recording) -> Snapshot:
    """What a listener makes of the frames alone."""
    listening = Listening(recording.spec, recording.frames[0].time_ns, tables=tables_of(recording.spec))
    events = [one for f in recording.frames for one in listening.take(f.channel, f.time_ns, f.frame)]
    return Reducer(recording.spec).all(events, Reducer(recording.spec).start("bus")).snapshot


def test_a_log_tells_what_happened_and_why() -> None:
    view = big_blue().timeline().last()
    assert (view.source, view.knows_why, view.phase) == ("log", True, "ascent")
    causes = [cause for one in view.reconfigurations for cause in one.causes]
    assert "pe:nav: silent for 3 heartbeat periods" in causes
    assert "pe:nav joined" in causes
    assert "pe:tail_b: silent for 3 heartbeat periods" in causes
    loss = next(one for one in view.reconfigurations if any("pe:nav: silent" in cause for cause in one.causes))
    assert all(ns is not None for ns in vars_of(loss.times_ns))
    assert view.pes["tail_b"].standing == "down"
    assert view.pes["nav"].reboots == 1
    assert view.functions["elevator"].heard is True
    bus = view.buses["can0"]
    assert 0 < bus.load <= bus.peak < 1
    assert bus.planned > 0
    assert sum(bus.bits_per_s.values()) == pytest.approx(bus.load * bus.bit_rate, rel=0.01)


def vars_of(times) -> list[int | None]:
    return [times.detect, times.decide, times.distribute, times.activate]


def test_the_frames_alone_tell_the_same_but_why() -> None:
    known, view = big_blue().timeline().last(), alone(big_blue())
    assert [(one.epoch, one.moved, one.lost) for one in view.reconfigurations] == [
        (one.epoch, one.moved, one.lost) for one in known.reconfigurations
    ]
    assert {name: module.pe for name, module in view.modules.items()} == {n: m.pe for n, m in known.modules.items()}
    assert {name: pe.standing for name, pe in view.pes.items()} == {n: p.standing for n, p in known.pes.items()}
    assert {name: (f.served, f.mode) for name, f in view.functions.items()} == {
        name: (f.served, f.mode) for name, f in known.functions.items()
    }
    assert all(one.causes == () for one in view.reconfigurations)
    assert (view.manager.node, view.manager.term) == (known.manager.node, known.manager.term)
    theirs, ours = known.reconfigurations[1], view.reconfigurations[1]
    assert ours.times_ns.detect == pytest.approx(theirs.times_ns.detect, abs=3 * MS)
    assert ours.times_ns.distribute == pytest.approx(theirs.times_ns.distribute, abs=3 * MS)


def test_a_log_that_begins_in_flight_tells_no_causes(tmp_path: Path) -> None:
    later = tmp_path / "later.log"
    frames = [logged for logged in big_blue().frames if logged.time_ns - DATE_NS > 600 * MS]
    later.write_text("".join(format_log_line(logged) + "\n" for logged in frames))
    view = open_recording(later, "big_blue").timeline().last()
    assert not view.knows_why
    assert view.epoch == big_blue().timeline().last().epoch
    early = open_recording(later, "big_blue").timeline().at(frames[0].time_ns + 100 * MS)
    assert early.unknown_epoch == 1


def test_error_frames_and_the_state_of_the_controller_are_counted() -> None:
    spec = big_blue().spec
    listening = Listening(spec, 0)
    passive = Frame(0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]), error=True)
    extended = Frame(0x1234567, b"", extended=True)
    for number in range(20):
        listening.take("can0", number * 100 * MS, passive if number < 3 else extended)
    view = Reducer(spec).all(listening.until(10_000 * MS)).snapshot
    assert (view.buses["can0"].errors, view.buses["can0"].error_state) == (3, "error_passive")


def test_a_channel_of_another_name_is_the_managers_bus_and_other_channels_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "other.log"
    frames = [logged for logged in big_blue().frames if logged.channel == "can0"][:3000]
    file.write_text("".join(format_log_line(logged._replace(channel="vcan7")) + "\n" for logged in frames))
    assert open_recording(file, "big_blue").timeline().last().buses["can0"].load > 0


def test_a_log_of_another_spec_is_refused_as_a_replay_refuses_it() -> None:
    with pytest.raises(UserError, match="is no configuration of elevator_and_chute: give the spec of the recording"):
        open_recording(big_blue_log(), "elevator_and_chute")


def test_events_of_a_manager_and_a_scenario_are_feeds_too(tmp_path: Path) -> None:
    file = tmp_path / "events.jsonl"
    file.write_text("words\n[]\n" + "".join(to_line(one) + "\n" for one in ALL))
    view = open_recording(file, "big_blue").timeline().last()
    assert (view.epoch, view.source) == (2, "record")
    flown = open_recording(Path("tests/scenarios/a_bad_transmitter.scenario"), None)
    view = flown.timeline().last()
    assert (view.source, view.knows_why) == ("simulator", True)
    assert view.reconfigurations


def test_what_cannot_be_opened_is_said_in_a_sentence(tmp_path: Path) -> None:
    empty = tmp_path / "empty.jsonl"
    empty.write_text("nothing\n")
    for path, spec, words in (
        (tmp_path, None, "is no folder of 'heronry record'"),
        (big_blue_log(), None, "write SPEC after the file"),
        (empty, "big_blue", "holds no event"),
    ):
        with pytest.raises(UserError, match=words):
            open_recording(path, spec)


# Any moment


def test_any_moment_of_a_recording_is_that_of_the_events_before_it() -> None:
    recording = big_blue()
    timeline, reducer = Timeline(Reducer(recording.spec), recording.events), Reducer(recording.spec)
    for share in (1.0, 0.2, 0.6, 0.0):
        at_ns = timeline.begins_ns + round(share * (timeline.ends_ns - timeline.begins_ns))
        before = [one for one in recording.events if one.t_ns <= at_ns]
        assert timeline.at(at_ns) == reducer.all(before, reducer.start("log")).snapshot


def test_a_cursor_moves_plays_and_stops_at_the_ends() -> None:
    now_ns = 0
    source = RecordedSource(big_blue(), lambda: now_ns)
    ends = source.timeline.ends_ns
    source.play()  # from the begin, since it is at the end
    now_ns += 100 * MS
    source.look()
    assert source.at_ns == source.timeline.begins_ns + 100 * MS
    source.play()
    now_ns += 100 * MS
    source.look()
    assert source.at_ns == source.timeline.begins_ns + 500 * MS
    assert "4x" in source.note()
    now_ns += 100_000 * MS
    source.look()
    assert source.at_ns == ends
    source.to_reconfiguration(is_next=False)
    assert source.at_ns == source.timeline.reconfigurations()[-1].done_ns
    source.to_reconfiguration(is_next=True)
    assert source.at_ns == ends
    source.move(-(10**15))
    source.to_reconfiguration(is_next=False)
    assert source.at_ns == source.timeline.begins_ns
    assert source.readers() == ()
    source.close()


# The same everywhere


def snapshot_of_web(recording: Recording) -> dict[str, Any]:
    """What `heronry web` answers for a recording."""
    spec, file = recording.spec, shipped_spec_path("big_blue")
    shown = WebRecording(Reducer(spec), recording.events, recording.source)
    site = Site(spec, shown, Questions(spec, file), Orders(None), Access("127.0.0.1", 8321, "token"))
    with TestClient(application(site), base_url="http://127.0.0.1:8321") as asking:
        told: dict[str, Any] = asking.get("/api/snapshot").json()
        return told


def test_the_same_log_gives_the_same_final_snapshot_through_top_web_json_and_metrics(
    capsys: pytest.CaptureFixture[str],
) -> None:
    view = big_blue().timeline().last()
    log, told = str(big_blue_log()), json.loads(json.dumps(document(view)))
    assert RecordedSource(big_blue()).snapshot() == view
    assert snapshot_of_web(big_blue()) == told
    assert main(["top", "--json", "--once", "--log", log, "big_blue"]) == 0
    assert json.loads(capsys.readouterr().out) == told
    assert main(["metrics", "--log", log, "big_blue"]) == 0
    page = capsys.readouterr().out
    assert page == exposition(view).decode()
    found = {
        (sample.name, *sorted(sample.labels.values())): sample.value
        for family in text_string_to_metric_families(page)
        for sample in family.samples
    }
    assert found["heronry_epoch",] == view.epoch
    assert found["heronry_reconfigurations_total",] == view.reconfigurations[-1].number
    assert found["heronry_last_reconfiguration_seconds", "detect"] == view.reconfigurations[-1].times_ns.detect / 1e9
    for name, pe in view.pes.items():
        assert found["heronry_pe_standing", *sorted((name, pe.standing))] == 1
        assert found["heronry_pe_cpu_planned_ratio", name] == pytest.approx(pe.cpu.used / pe.cpu.of)
    for name, bus in view.buses.items():
        assert found["heronry_bus_load_ratio", name] == bus.load
    for name, one in view.functions.items():
        assert found["heronry_function_served", *sorted((name, one.criticality))] == float(one.served)


def test_metrics_leave_out_what_is_not_known() -> None:
    spec = big_blue().spec
    view = Reducer(spec).start().snapshot
    page = exposition(view).decode()
    assert "\nheronry_epoch " not in page
    assert "heronry_bus_load_ratio{" not in page
    radio = next(bus.name for bus in spec.buses.values() if bus.kind == "wireless")
    limited = replace(view, buses={**view.buses, radio: replace(view.buses[radio], link="40%")})
    assert f'heronry_link_usable_ratio{{bus="{radio}"}} 0.4' in exposition(limited).decode()


def test_the_command_line_of_top(capsys: pytest.CaptureFixture[str]) -> None:
    log = str(big_blue_log())
    assert main(["top", "--schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"].startswith("heronry snapshot")
    for typed, words in (
        (["--once"], "add --json"),
        (["--log", log, "big_blue"], "no terminal"),
        (["--json", "big_blue"], "add -i and -c"),
        (["--json", "--log", log], "write SPEC after the file"),
        (["--json", "--log", log, "big_blue", "-c", "x"], "only one of them"),
        (["--json", "-i", "socketcan", "-c", "x"], "does not name its spec"),
        (["--json", "--of", "nobody"], "no manager listens"),
    ):
        assert main(["top", *typed]) == 2, typed
        assert words in capsys.readouterr().err
    assert main(["top", "--json", "--log", log, "big_blue", "--at", "0.5"]) == 0
    view = json.loads(capsys.readouterr().out)
    assert view["t_ns"] - view["began_ns"] <= 500 * MS


def test_top_is_imported_only_where_it_is_shown() -> None:
    code = "import sys, heronry_tools.commands.top; print('textual' in sys.modules or 'ortools' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out == "False\n"
