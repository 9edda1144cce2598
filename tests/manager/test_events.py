"""The one stream of events: a flight as its snapshot tells it, and every emitted event as it is documented."""

import ast
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_manager.core.events import KINDS, VERSION, Snapshot, event, reduce, to_line
from lab.documents.event_table import fields_of

MS = 1_000_000
TIMES = {"detect": 60 * MS, "decide": 40 * MS, "distribute": 9 * MS, "activate": 5 * MS}
FIRST_PLAN = {"phase": "glide", "modules": {"autopilot": {"pe": "nav", "mode": "only"}}}
SECOND_PLAN = {"phase": "glide", "modules": {"autopilot": {"pe": "air", "mode": "only"}}}


def reconfigured(now_ns: int, epoch: int, cause: str, **modules: list[str]) -> dict[str, Any]:
    changes = {"moved": [], "started": [], "stopped": [], **modules}
    return event("reconfigured", now_ns, epoch=epoch, causes=[cause], times_ns=TIMES, **changes)


START = [
    event(
        "manager_started",
        0,
        spec="big_blue",
        spec_digest="ab" * 32,
        node=126,
        term=3,
        bus="can0",
        phase="ascent",
        advises=False,
        key=None,
    ),
    event("bus", 1, name="can0", interface="softbus", channel="can0.sock", models="all but bit errors"),
    event("pe_joined", 10 * MS, pe="nav", cause="first heard"),
    event("pe_joined", 11 * MS, pe="air", cause="first heard"),
    event("pe_absent", 12 * MS, pe="ground", cause="not heard since the start"),
    event("plan_requested", 12 * MS, request=1, down=["pe:ground"], limits={}, phase="glide", causes=["pe:air joined"]),
    event("plan_ready", 60 * MS, request=1, plan=FIRST_PLAN, decide_ns=48 * MS),
    event("epoch_prepared", 60 * MS, epoch=1, digest="0000AB", contingency=0, pes=["nav", "air"], bytes=40),
    event("epoch_step", 69 * MS, epoch=1, step="GO_ALL", waiting_for=[]),
]
RUNS = reconfigured(74 * MS, 1, "pe:air joined", started=["autopilot"])
LOSS = [
    event("pe_suspected", 1025 * MS, pe="nav", cause="a period was missed", silent_ns=25 * MS),
    event("pe_lost", 1065 * MS, pe="nav", cause="silent for 3 periods", last_heard_ns=1000 * MS),
    event("fault_reported", 1066 * MS, element="device:pitot", by="air", detail=7, code="REPORTED"),
    event(
        "plan_requested",
        1066 * MS,
        request=2,
        down=["pe:ground", "pe:nav"],
        limits={},
        phase="glide",
        causes=["pe:nav"],
    ),
]
RECOVERY = [
    event("plan_failed", 1070 * MS, request=2, reason="the planner was restarted"),
    event(
        "plan_requested",
        2070 * MS,
        request=3,
        down=["pe:ground", "pe:nav"],
        limits={},
        phase="glide",
        causes=["pe:nav"],
    ),
    event("plan_ready", 2100 * MS, request=3, plan=SECOND_PLAN, decide_ns=1030 * MS),
    event("epoch_prepared", 2100 * MS, epoch=2, digest="0000AC", contingency=0, pes=["air"], bytes=20),
    event("epoch_step", 2110 * MS, epoch=2, step="GO_ALL", waiting_for=[]),
    reconfigured(2120 * MS, 2, "pe:nav", moved=["autopilot"]),
    event("pe_heard_again", 3000 * MS, pe="nav", cause="heard after a silence"),
]
END = [
    event("pe_joined", 3200 * MS, pe="nav", cause="steady again"),
    event(
        "plan_requested", 3200 * MS, request=4, down=["pe:ground"], limits={}, phase="glide", causes=["pe:nav joined"]
    ),
    event("plan_ready", 3230 * MS, request=4, plan=SECOND_PLAN, decide_ns=30 * MS),
    event("plan_unchanged", 3230 * MS, request=4),
    event("journal_failed", 4990 * MS, problem="No space left on device"),
    event("journal_kept", 4995 * MS, before="No space left on device"),
    event("second_manager", 5000 * MS, node=127, term=4),
    event("stopped", 5000 * MS, reason="manager 127 is active with the higher term 4"),
]


def test_a_flight_as_its_snapshot_tells_it() -> None:
    view = reduce(START)
    assert (view.spec, view.stage, view.epoch) == ("big_blue", "activating", 0)
    assert view.pes == {"nav": "up", "air": "up", "ground": "down"}
    view = reduce([RUNS], view)
    assert (view.stage, view.epoch, view.phase, view.plan) == ("running", 1, "glide", FIRST_PLAN)
    view = reduce(LOSS[:1], view)
    assert (view.pes["nav"], view.stage) == ("suspect", "running")
    view = reduce(LOSS[1:], view)
    assert (view.pes["nav"], view.failed, view.stage) == ("down", ["device:pitot"], "planning")
    assert view.plan == FIRST_PLAN
    view = reduce(RECOVERY, view)
    assert (view.pes["nav"], view.stage, view.epoch, view.plan) == ("returning", "running", 2, SECOND_PLAN)
    assert [json.loads(line)["event"] for line in view.problems] == ["plan_failed"]
    assert [one["times_ns"] for one in view.reconfigurations] == [TIMES, TIMES]
    view = reduce(END[:4], view)
    assert (view.pes["nav"], view.stage, view.epoch) == ("up", "running", 2)
    view = reduce(END[4:], view)
    assert view.stage == "stopped"
    assert "second_manager" in view.problems[-1]


ALL = [*START, RUNS, *LOSS, *RECOVERY, *END]


@given(st.integers(0, len(ALL)))
def test_a_view_may_start_anywhere_and_leaves_what_it_started_from_alone(cut: int) -> None:
    before = reduce(ALL[:cut])
    kept = asdict(before)
    assert reduce(ALL[cut:], before) == reduce(ALL)
    assert asdict(before) == kept


def test_a_recorded_stream_gives_the_same_snapshot_as_a_live_one() -> None:
    recorded = "".join(to_line(one) + "\n" for one in ALL)
    assert recorded.count("\n") == len(ALL)
    assert reduce(map(json.loads, recorded.splitlines())) == reduce(ALL)


def test_a_fault_that_is_reported_twice_is_latched_once() -> None:
    assert reduce([LOSS[2], LOSS[2]]).failed == ["device:pitot"]


def test_a_fault_that_is_cleared_and_a_phase_that_is_entered_are_shown() -> None:
    view = reduce([event("fault_cleared", MS, element="device:pitot", by="the operator")], reduce([LOSS[2]]))
    assert view.failed == []
    entered = event("phase_changed", MS, phase="land", before="climb", by="the operator")
    assert reduce([entered], view).phase == "land"


def test_a_radio_is_shown_while_it_is_not_whole() -> None:
    view = reduce([event("link_limited", MS, bus="radio", by="comms", share="40%")])
    assert view.links == {"radio": "40%"}
    view = reduce([event("link_gone", 2 * MS, bus="radio", by="comms")], view)
    assert view.links == {"radio": "gone"}
    view = reduce([event("link_back", 3 * MS, bus="radio", by="comms")], view)
    assert view.links == {}
    view = reduce([event("link_limited", 4 * MS, bus="radio", by="comms", share="60%")], view)
    assert reduce([event("link_limited", 5 * MS, bus="radio", by="comms", share="100%")], view).links == {}


def test_kinds_of_a_later_version_change_nothing() -> None:
    assert reduce([{"v": 2, "t_ns": 1, "event": "landed", "where": "sea"}, {}]) == Snapshot()


def test_an_event_has_version_time_and_kind_and_an_unknown_kind_is_a_defect() -> None:
    assert event("stopped", 5, reason="done") == {"v": VERSION, "t_ns": 5, "event": "stopped", "reason": "done"}
    with pytest.raises(KeyError, match="landed"):
        event("landed", 5)


# What is emitted


def emissions() -> Iterator[tuple[str, str, set[str | None]]]:
    """Place, kind and fields of every call, in manager and tools, that builds an event of a named kind."""
    for file in sorted([*Path("manager").rglob("*.py"), *Path("tools").rglob("*.py")]):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and name_of(node.func) in ("_emit", "emit", "make_event", "event"):
                kinds = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                for kind in kinds[:1]:
                    yield f"{file}:{node.lineno}", kind, {keyword.arg for keyword in node.keywords}


def name_of(function: ast.expr) -> str:
    return (
        function.attr if isinstance(function, ast.Attribute) else function.id if isinstance(function, ast.Name) else ""
    )


def test_every_event_that_is_emitted_is_documented_field_by_field() -> None:
    found = list(emissions())
    assert [one for one in found if one[1] not in KINDS] == []
    assert [(place, fields) for place, kind, fields in found if fields != set(fields_of(kind))] == []


def test_every_documented_event_is_emitted_somewhere() -> None:
    assert KINDS.keys() - {kind for _, kind, _ in emissions()} == set()


def test_the_flight_above_is_made_of_such_events() -> None:
    for one in ALL:
        assert one.keys() - {"v", "t_ns", "event"} == set(fields_of(one["event"]))


def test_the_nodes_that_lack_a_channel_are_known_until_it_is_back() -> None:
    lost = [event("channel_lost", 1, channel="can0.2", by=by) for by in ("nav", "the manager", "nav")]
    view = reduce(lost)
    assert view.lost_channels == {"can0.2": ["the manager", "nav"]}
    assert reduce([event("channel_back", 2, channel="can0.2", by="nav")], view).lost_channels == {
        "can0.2": ["the manager"]
    }
    both = [event("channel_back", 2, channel="can0.2", by=by) for by in ("nav", "the manager")]
    assert reduce(both, view).lost_channels == {}
    assert view.lost_channels == {"can0.2": ["the manager", "nav"]}
