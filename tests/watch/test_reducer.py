"""The reducer of all views: a flight as its snapshot tells it, whatever feed it comes from."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.events import (
    Adopted,
    BusSeen,
    BusTrouble,
    ChannelBack,
    ChannelLost,
    EpochAbandoned,
    EpochPrepared,
    EpochSeen,
    FaultCleared,
    Feed,
    Heard,
    LinesLost,
    LinkBack,
    LinkGone,
    LinkLimited,
    ManagerSeen,
    ModuleFailed,
    ModuleRestarted,
    PeAnswered,
    PeSeen,
    PeSuspected,
    PhaseChanged,
    PlanReady,
    PriorityChanged,
    Resumed,
    Runs,
    ScriptEnded,
    ScriptRefused,
    ScriptTaken,
    StandingBy,
    StoodStill,
    Stopped,
    TakenOver,
    Times,
    UnknownEpoch,
    UnknownEvent,
)
from heronry_manager.events import Outage as OutageEvent
from heronry_manager.events import Place as BusPlace
from heronry_manager.events import Status as StatusEvent
from heronry_manager.events.line import to_line
from heronry_manager.events.reading import events_in
from heronry_tools.console.spec_files import load_spec
from heronry_tools.watch.graph_marks import LiveGraphs
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.schema import SCHEMA_FILE, schema_text
from heronry_tools.watch.snapshot import KEPT_EVENTS, KEPT_RECONFIGURATIONS, Outage, Place, Script, Snapshot, document
from watch.flights import ALL, END, LOSS, MS, RECOVERY, RUNS, START, TIMES, plan, reconfigured

SPEC: Spec = load_spec("big_blue")
REDUCER = Reducer(SPEC)


def snapshot(*events) -> Snapshot:
    return REDUCER.all(events).snapshot


def test_a_graph_is_made_once_for_each_situation_and_configuration() -> None:
    graphs, runs = LiveGraphs(SPEC), Configuration({"attitude_filter": Running("nav", "A")})
    elsewhere = Configuration({"attitude_filter": Running("air", "A")})
    fault = Situation(frozenset({"device:pitot"}))
    first = graphs.graph(Situation(), runs)
    assert graphs.graph(Situation(), Configuration(dict(runs.modules))) is first
    assert graphs.graph(fault, runs).nodes["device:pitot"] == "dead" != first.nodes["device:pitot"]
    assert graphs.graph(Situation(), Configuration()).nodes["module:attitude_filter"] == "idle"
    assert graphs.graph(Situation(), elsewhere) == first
    for n in range(40):
        graphs.graph(Situation(priorities={"elevator": n + 1}), runs)
    again = graphs.graph(Situation(), runs)
    assert again == first
    assert again is not first, "only the last few are remembered"


def test_a_flight_as_its_snapshot_tells_it() -> None:
    state = REDUCER.all(START)
    view = state.snapshot
    assert (view.spec, view.stage, view.epoch, view.next_epoch) == ("big_blue", "activating", None, 1)
    assert {name: pe.standing for name, pe in view.pes.items() if pe.standing != "waiting"} == {
        "nav": "up",
        "air": "up",
        "ground": "down",
    }
    assert view.functions["elevator"].why_not == "nothing runs yet"
    state = REDUCER.after(state, RUNS)
    view = state.snapshot
    assert (view.stage, view.epoch, view.next_epoch) == ("running", 1, None)
    assert (view.modules["attitude_filter"].pe, view.pes["nav"].modules) == ("nav", ("attitude_filter",))
    assert (view.pes["nav"].cpu.used, view.buses["can0"].planned) == (70, 0.25)
    assert view.graph.nodes["module:attitude_filter"] == "served"
    assert view.reconfigurations[0].gained == ("elevator", "rudder")
    state = REDUCER.all(LOSS, state)
    view = state.snapshot
    assert (view.pes["nav"].standing, view.pes["nav"].why, view.stage) == ("down", "silent for 3 periods", "planning")
    assert [(fault.element, fault.by, fault.since_ns) for fault in view.faults] == [("device:pitot", "air", 1066 * MS)]
    assert {"pe:nav", "device:pitot", "pe:ground"} == set(view.down)
    assert view.graph.nodes["module:imu_driver_1"] == "dead"
    state = REDUCER.all(RECOVERY, state)
    view = state.snapshot
    assert (view.stage, view.epoch, view.pes["nav"].standing) == ("running", 2, "returning")
    last = view.reconfigurations[-1]
    assert (last.number, last.epoch, last.moved, last.causes) == (2, 2, ("attitude_filter",), ("pe:nav",))
    assert (last.lost, last.gained, last.kept) == (("rudder",), ("imaging",), ("elevator",))
    assert (last.before["attitude_filter"], last.after["attitude_filter"]) == (
        Place("nav", "fused"),
        Place("air", "fused"),
    )
    assert last.times_ns.detect == TIMES.detect
    assert last.done_ns - last.began_ns == sum(TIMES.by_name().values())
    view = REDUCER.all(END, state).snapshot
    assert (view.pes["nav"].standing, view.stage, view.manager.journal) == ("up", "stopped", None)


@given(st.integers(0, len(ALL)))
@settings(max_examples=5)
def test_a_view_may_start_anywhere_and_leaves_what_it_started_from_alone(cut: int) -> None:
    before = REDUCER.all(ALL[:cut])
    kept = json.dumps(document(before.snapshot))
    assert REDUCER.all(ALL[cut:], before) == REDUCER.all(ALL)
    assert json.dumps(document(before.snapshot)) == kept


def test_a_recorded_stream_gives_the_same_snapshot_as_a_live_one() -> None:
    recorded = "".join(to_line(one) + "\n" for one in ALL)
    assert REDUCER.all(events_in(recorded.splitlines())) == REDUCER.all(ALL)


def test_a_snapshot_comes_back_from_its_document() -> None:
    view = snapshot(*ALL)
    assert TypeAdapter(Snapshot).validate_json(json.dumps(document(view)), strict=False) == view


def test_the_schema_file_is_that_of_the_snapshot() -> None:
    assert SCHEMA_FILE.read_text() == schema_text(), "write it anew: heronry top --schema > " + str(SCHEMA_FILE)


def test_every_document_fits_the_schema() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    check = jsonschema.Draft202012Validator(json.loads(SCHEMA_FILE.read_text()))
    for cut in (0, 5, len(ALL)):
        check.validate(json.loads(json.dumps(document(snapshot(*ALL[:cut])))))


def test_kinds_of_a_later_version_only_count() -> None:
    view = snapshot(UnknownEvent(1, "landed", {"where": "sea"}), UnknownEvent(1, "", {}))
    assert (view.events, view.told) == (2, ())


def test_a_fault_that_is_reported_twice_is_latched_once_until_it_is_cleared() -> None:
    assert len(snapshot(LOSS[2], LOSS[2]).faults) == 1
    assert snapshot(LOSS[2], FaultCleared(9, element="device:pitot", by="operator")).faults == ()


def test_a_radio_is_shown_while_it_is_not_whole() -> None:
    radio = next(bus.name for bus in SPEC.buses.values() if bus.kind == "wireless")
    limited = LinkLimited(MS, bus=radio, by="comms", share="40%")
    gone, back = LinkGone(2 * MS, bus=radio, by="comms"), LinkBack(2 * MS, bus=radio, by="comms")
    assert snapshot(limited).buses[radio].link == "40%"
    assert snapshot(limited, gone).buses[radio].link == "gone"
    assert snapshot(limited, gone, back).buses[radio].link is None
    assert snapshot(LinkLimited(MS, bus="another", by="x", share="1%")).buses.keys() == SPEC.buses.keys()


def test_the_nodes_that_lack_a_channel_are_known_until_it_is_back() -> None:
    lost = [ChannelLost(1, channel="can0.2", by=by) for by in ("nav", "the manager", "nav")]
    assert snapshot(*lost).buses["can0"].channels["can0.2"] == ("the manager", "nav")
    back = [ChannelBack(2, channel="can0.2", by="nav")]
    assert snapshot(*lost, *back).buses["can0"].channels["can0.2"] == ("the manager",)
    assert snapshot(ChannelLost(1, channel="x.2", by="nav")).buses == snapshot().buses


def test_modules_that_fail_and_restart_are_counted_with_their_pe() -> None:
    element = "module:attitude_filter"
    restarts = [ModuleRestarted(n, element=element, by="nav", times=n) for n in (1, 2, 2)]
    failed = ModuleFailed(3, element=element, by="nav", text="ValueError: 1, in filter.py, line 4", heard_ns=2)
    strange = [replace(one, element="module:flaps") for one in (restarts[0], failed)]
    view = snapshot(*restarts, failed, *strange)
    assert (view.modules["attitude_filter"].restarts, view.pes["nav"].restarts) == (2, 2)
    assert view.modules["attitude_filter"].failure == failed.text


def test_priorities_hold_until_the_specs_is_back() -> None:
    changed = PriorityChanged(1, function="imaging", priority=90, before="default", by="operator")
    view = snapshot(changed)
    assert (view.priorities, view.functions["imaging"].priority) == ({"imaging": 90}, 90)
    assert snapshot(changed, replace(changed, priority="default")).priorities == {}


def test_a_silence_belongs_to_the_reconfiguration_in_which_it_began() -> None:
    silent = OutageEvent(0, function="elevator", from_ns=2100 * MS, to_ns=None, gathered=False)
    over = replace(silent, to_ns=2200 * MS)
    whole = Outage("elevator", 2100 * MS, 2200 * MS)
    for story in ([*ALL, silent, over], [*START, RUNS, *LOSS, silent, *RECOVERY, over]):
        view = snapshot(*story)
        assert [one.outages for one in view.reconfigurations] == [(), (whole,)]
        assert view.outages == (whole,)


def test_what_a_bus_shows_of_a_pe() -> None:
    seen = PeSeen(5 * MS, pe="nav", incarnation=7, epoch=3, runs="ACTIVE", hears_manager=True, load_percent=None)
    again = replace(seen, t_ns=6 * MS, incarnation=8)
    view = snapshot(seen, again, replace(seen, pe="stranger"))
    assert (view.pes["nav"].incarnation, view.pes["nav"].reboots, view.pes["nav"].last_heard_ns) == (8, 1, 6 * MS)
    heard = Heard(9 * MS, pes={"nav": 9 * MS}, functions={"elevator": (8 * MS, True)})
    view = snapshot(seen, heard)
    assert (view.pes["nav"].last_heard_ns, view.functions["elevator"].heard) == (9 * MS, True)


def test_what_a_bus_shows_of_traffic_manager_and_epochs() -> None:
    traffic = {"load": 0.3, "peak": 0.5, "bits_per_s": {"data": 9}, "frames_per_s": 1, "errors": 2, "error_state": None}
    events = [
        Feed(0, source="bus", knows_why=False, spec="big_blue", spec_digest=""),
        BusSeen(1, bus="can0", **traffic),
        BusSeen(1, bus="another", **traffic),
        ManagerSeen(2, node=127, term=4),
        EpochSeen(90, epoch=1, plan=plan("nav", elevator="only"), began_ns=50, times_ns=Times(None, None, None, 9)),
    ]
    view = snapshot(*events)
    assert (view.source, view.knows_why, view.buses["can0"].peak) == ("bus", False, 0.5)
    assert (view.manager.node, view.manager.term, view.epoch) == (127, 4, 1)
    assert (view.reconfigurations[0].began_ns, view.reconfigurations[0].causes) == (50, ())
    assert view.reconfigurations[0].times_ns.detect is None
    unknown = EpochSeen(99, epoch=2, plan=None, began_ns=95, times_ns=Times(None, None, None, None))
    view = snapshot(*events, unknown)
    assert (view.unknown_epoch, view.functions["elevator"].served) == (2, None)
    view = snapshot(*events, UnknownEpoch(99, epoch=2))
    assert (view.epoch, view.modules["attitude_filter"].pe) == (None, None)


def test_a_take_over_an_adoption_and_what_runs() -> None:
    events = [
        StandingBy(1, node=126, term=2),
        TakenOver(2, term=3, before=2, silent_ns=5, phase="glide"),
        Adopted(3, epoch=9, digest="0000AB"),
        Runs(4, epoch=9, plan=plan("nav", elevator="only")),
        StoodStill(6, by="nav", for_ns=MS, times=3),
        BusTrouble(7, sentence="the bus is off"),
        LinesLost(8, lines=4),
        EpochPrepared(9, epoch=10, digest="", contingency=0, pes=(), bytes=0),
        EpochAbandoned(10, epoch=10, reason="a fault"),
    ]
    view = snapshot(*events)
    assert (view.manager.term, view.phase, view.epoch, view.next_epoch) == (3, "glide", 9, None)
    assert view.modules["attitude_filter"].pe == "nav"
    assert [(one.epoch, one.causes, one.times_ns.activate) for one in view.reconfigurations] == [(9, (), None)]
    assert "9" in view.reconfigurations[0].sentence
    assert len(snapshot(*events, Adopted(11, epoch=9, digest="0000AB")).reconfigurations) == 1
    assert (view.pes["nav"].stood_still, view.buses["can0"].trouble, view.lost_lines) == (3, "the bus is off", 4)
    assert snapshot(*events[:2]).manager.state == "active"
    assert snapshot(events[0]).manager.state == "standby"


def test_what_the_phase_no_longer_wants_is_not_lost() -> None:
    name, phase, later = next(
        (one.name, phase, later)
        for one in SPEC.functions.values()
        for phase in SPEC.phases
        for later in SPEC.phases
        if one.priority_in(phase) > 0 == one.priority_in(later)
    )
    begun = [
        PhaseChanged(1, phase=phase, before="", by="operator"),
        Runs(2, epoch=1, plan=plan("nav", **{name: "only"})),
    ]
    after = [
        PlanReady(4, request=2, plan=plan("nav", **{name: None}), decide_ns=1),
        EpochPrepared(5, epoch=2, digest="", contingency=0, pes=("nav",), bytes=1),
        reconfigured(6, 2, "x"),
    ]
    changed = PhaseChanged(3, phase=later, before=phase, by="operator")
    (last,) = snapshot(*begun, changed, *after).reconfigurations
    assert (last.lost, last.unwanted) == ((), (name,))
    (last,) = snapshot(*begun, *after).reconfigurations
    assert (last.lost, last.unwanted) == ((name,), ())


def test_the_last_script_is_told() -> None:
    taken, refused = ScriptTaken(1, reason="not worse"), ScriptRefused(2, reason="worse")
    ended = ScriptEnded(3, reason="the operator released it")
    assert snapshot(taken).script == Script("held")
    assert snapshot(refused).script == Script("refused", "worse")
    assert snapshot(taken, refused).script == Script("held")  # the one that was held before stays
    assert snapshot(taken, ended).script == Script("ended", "the operator released it")
    over = TakenOver(4, term=3, before=2, silent_ns=5, phase="glide")
    assert snapshot(taken, over).script == Script()


def test_only_the_last_events_and_reconfigurations_are_kept() -> None:
    many = [reconfigured(number * MS, number, "x") for number in range(1, KEPT_EVENTS + 10)]
    view = snapshot(*many[: KEPT_RECONFIGURATIONS + 10])
    assert [one.number for one in view.reconfigurations][:2] == [11, 12]
    assert len(view.reconfigurations) == KEPT_RECONFIGURATIONS
    first, second = snapshot(*ALL).reconfigurations[:2]
    assert second.before is first.after  # a hundred of them are kept
    stopped = [Stopped(n, reason="x") for n in range(KEPT_EVENTS + 10)]
    told = snapshot(*stopped).told
    assert (len(told), told[-1].number) == (KEPT_EVENTS, KEPT_EVENTS + 10)


def test_a_pe_that_is_suspected_and_answers_is_not_listed() -> None:
    view = snapshot(PeSuspected(1, pe="nav", cause="x", silent_ns=1), PeAnswered(2, pe="nav"))
    assert (view.told, view.pes["nav"].standing) == ((), "up")


def test_the_page_tells_of_every_key() -> None:
    page = Path("docs/watch.md").read_text()
    assert [name for name in document(snapshot()) if f"`{name}`" not in page] == []


# Damaged recordings


def test_names_that_the_spec_does_not_have_are_passed_over() -> None:
    heard = Heard(99, {"nav": 98, "nap": 97}, {"elevator": (98, True), "elevatro": (97, True)})
    view = snapshot(*START, heard)
    assert (view.pes["nav"].last_heard_ns, view.functions["elevator"].heard) == (98, True)
    assert set(view.pes) == set(load_spec("big_blue").pes)


def test_of_a_document_of_another_form_nothing_is_used() -> None:
    before = snapshot(*START, RUNS)
    whole = document(before)
    place = BusPlace("can0", "softbus", "x")
    for damaged in (
        StatusEvent(99, {}, None, place, "x"),
        StatusEvent(99, {"manager": 7}, None, place, "x"),
        Resumed(99, {}, None),
        Resumed(99, {**whole, "pes": {}}, None),
        Resumed(99, {**whole, "modules": {**whole["modules"], "flaps": {}}}, None),
        Resumed(99, {**whole, "t_ns": "late"}, None),
    ):
        view = snapshot(*START, RUNS, damaged)
        assert (view.pes, view.functions, view.manager) == (before.pes, before.functions, before.manager), damaged


def test_a_reconfiguration_without_causes_and_a_strange_share_are_shown() -> None:
    assert snapshot(*START, replace(RUNS, causes=())).told[-1].sentence.startswith("epoch 1 runs: ")
    assert snapshot(*START, LinkLimited(99, "radio", "comms", "lots")).buses["radio"].link == "lots"


def test_a_silence_is_shown_from_its_begin_to_its_end() -> None:
    reducer = REDUCER
    begun = events.InputSilent(5, module="chute_logic", by="control_pe", variable="altitude", producer="fused")
    also = events.OutputSilent(6, module="fused", by="sensor_pe", variable="altitude")
    over = events.SilenceOver(
        7, module="chute_logic", by="control_pe", variable="altitude", what="input", why="data come again", for_ns=2
    )
    told = reducer.all((begun, also))
    assert [(one.module, one.what, one.producer, one.since_ns) for one in told.snapshot.silences] == [
        ("chute_logic", "input", "fused", 5),
        ("fused", "output", None, 6),
    ]
    assert [one.module for one in reducer.after(told, over).snapshot.silences] == ["fused"]
