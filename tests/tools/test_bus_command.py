"""`heronry bus`: the messages on every bus under a plan, and whether they come in time."""

import json
import re
import sys
from fractions import Fraction
from pathlib import Path

import pytest

from heronry_dg.bus_schedule import BusSchedule, bus_schedules
from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.echo_rates import EchoRates
from heronry_dg.loader import load, loads
from heronry_dg.response_times import ResponseTimes
from heronry_dg.shipped import example_specs, shipped_spec_path
from heronry_dg.situation import situation, survivors
from heronry_dg.traffic import bus_loads_mbit_per_s, hops
from heronry_manager.planner.exact import plan
from heronry_tools.cli import main
from heronry_wire.identifiers import Use, classify

# Readings cross a bus of 20 kbit/s, and go on to a second one.
SLOW = """
dg: 1
name: slow
buses: {near: {bitrate: 20000, heartbeat_ms: 200}, far: {bitrate: 1000000}}
pes:
  eye:  {node_id: 92, buses: [near], cpu: 1, ram: 1MiB, flash: 1MiB}
  gate: {node_id: 93, buses: [near, far], cpu: 1, ram: 1MiB, flash: 1MiB}
  hand: {node_id: 94, buses: [far], cpu: 1, ram: 1MiB, flash: 1MiB}
variables: {view: {type: FLOAT, deadline_ms: 200}}
modules:
  look: {runs_on: [eye], gives: {view: 1}, cpu: 0.1, ram: 1KiB, rate_hz: RATE}
  act: {needs: view, runs_on: [hand], cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {acting: {output: act}}
"""
RUNNING = Configuration({"look": Running("eye", "only"), "act": Running("hand", "only", {"": Wire("look", "view", 1)})})


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    out, err = capsys.readouterr()
    return code, out, err


def schedules_of(name: str, *down: str) -> tuple[list[BusSchedule], Configuration]:
    spec = load(shipped_spec_path(name))
    now = situation(spec, down)
    configuration = plan(spec, now).configuration
    return bus_schedules(spec, now, configuration), configuration


def test_data_have_the_response_times_and_the_load_of_the_verifier() -> None:
    spec = load(shipped_spec_path("big_blue"))
    schedules, configuration = schedules_of("big_blue")
    published = hops(survivors(spec, situation(spec)), configuration)
    assessed = {
        (r.hop.bus, r.hop.variable, r.hop.producer): r.response_ns for r in ResponseTimes(spec).responses(published)
    }
    shown = {
        (s.bus.name, m.name, m.producer): m.response_ns
        for s in schedules
        for m in s.messages
        if m.kind == "data" and s.bus.kind == "wired"
    }
    assert shown == assessed
    exact = bus_loads_mbit_per_s(spec, published)
    assert {s.bus.name: s.data * 1000 * s.bus.bitrate for s in schedules} == exact


def test_everything_stands_in_order_of_priority_under_its_own_identifier() -> None:
    uses = {"management": {Use.MANAGEMENT, Use.STATE, Use.GATEWAY}, "data": {Use.STANDARD_DATA, Use.ALLOCATED_DATA}}
    uses["echo"] = {Use.ACTUATOR_ECHO}
    for schedule in schedules_of("big_blue")[0]:
        identifiers = [message.identifier for message in schedule.messages]
        assert identifiers == sorted(identifiers)
        alone = [message.identifier for message in schedule.messages if message.kind != "echo"]
        assert len(alone) == len(set(alone))  # the echoes of one PE share an identifier
        for message in schedule.messages:
            assert classify(message.identifier).use in uses.get(message.kind, {Use.HEARTBEAT})


def test_what_manages_comes_before_all_data_and_takes_the_reserve() -> None:
    (schedule,), _ = schedules_of("elevator_and_chute")
    first, second = schedule.messages[:2]
    assert (first.name, first.response_ns, second.name, second.response_ns) == ("LEASE", 270_000, "ALIVE", 405_000)
    echoes = 3 * 10 * 135  # of the three functions
    assert schedule.management == Fraction(5 * 135 * 50 + 4 * 65 + echoes, 1_000_000)
    assert schedule.reserve_left_frames_per_s == (100_000 - 5 * 135 * 50 - 4 * 65 - echoes) // 135
    assert schedule.share(first) == Fraction(135 * 50, 1_000_000)


def test_foreign_frames_stand_among_the_others_with_their_load_and_longest_time() -> None:
    """On the wire 300 << 18 comes after data 299 and before 301, and a range has the time of its last identifier."""
    foreign = (
        "{identifier: 100, bytes: 8, period_ms: 100}, {identifier: 402653184, extended: true, bytes: 8, period_ms: 50}"
        ", {range: [1800, 2047], bytes: 0, period_ms: 10}"
    )
    text = SLOW.replace("{bitrate: 1000000}", f"{{bitrate: 1000000, foreign: [{foreign}]}}").replace("RATE", "5")
    spec = loads(text, "slow.dg.yaml")
    _, far = bus_schedules(spec, situation(spec), RUNNING)
    names = [f"{m.kind} {m.identifier_text}" for m in far.messages]
    assert [name for name in names if "heartbeat" not in name] == [
        "foreign 100", "management 200", "management 201", "management 258", "management 259",
        "data 1536", "foreign 402653184x", "foreign 1800-2047", "echo 1922",
    ]  # fmt: skip
    first, (ranged,) = far.messages[0], [m for m in far.messages if m.last is not None]
    assert first.response_ns == 160_000 + 135_000
    assert far.blocking_ns == 160_000
    assert far.foreign == Fraction(1350 + 3200 + 5500, 1_000_000)
    assert ranged.response_ns is not None
    assert ranged.response_ns == max(m.response_ns or 0 for m in far.messages if m.kind != "data")
    assert far.data_limit == Fraction(7, 10) - far.foreign
    assert far.together == far.data + far.management + far.foreign


def test_a_gateway_reports_on_its_radio_toward_the_manager_alone() -> None:
    can0, radio = schedules_of("big_blue")[0]
    assert [(m.identifier, m.node) for m in can0.messages if m.name.startswith("link")] == [(291, "comms")]
    assert not any(m.name.startswith("link") for m in radio.messages)


@pytest.mark.parametrize("file", [shipped_spec_path("big_blue"), *example_specs()], ids=lambda file: file.name)
def test_what_is_listed_as_management_is_what_the_reserve_counts(file: Path) -> None:
    """Protocol rule 14: the list and DG307 count alike; of echoes the list has those of what runs."""
    spec = load(file)
    uses = EchoRates(spec).by_bus
    for schedule in bus_schedules(spec, situation(spec), plan(spec, situation(spec)).configuration):
        use, loads_of = uses[schedule.bus.name], dict.fromkeys(("management", "heartbeat", "echo"), Fraction(0))
        for message in schedule.messages:
            if message.kind in loads_of:
                loads_of[message.kind] += schedule.share(message) * schedule.bus.bitrate
        assert loads_of["management"] == use.periodic + use.passing + use.reports
        assert loads_of["heartbeat"] == use.heartbeats
        assert loads_of["echo"] <= use.echoes


def test_a_second_bus_holds_the_time_of_the_first_and_without_a_bound_there_is_none_after_it() -> None:
    spec = loads(SLOW.replace("RATE", "5"), "slow.dg.yaml")
    near, far = bus_schedules(spec, situation(spec), RUNNING)
    (here,), (there,) = ([m for m in s.messages if m.kind == "data"] for s in (near, far))
    assert here.response_ns is not None
    assert there.response_ns is not None
    assert there.response_ns > here.response_ns
    assert all(message.slack_ns is not None for message in far.messages)
    flooded = loads(SLOW.replace("RATE", "200"), "slow.dg.yaml")
    near, far = bus_schedules(flooded, situation(flooded), RUNNING)
    assert [m.response_ns for s in (near, far) for m in s.messages if m.kind != "management"] == [None] * 10
    assert near.data > near.data_limit


def test_the_report_shows_each_message_and_the_totals(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "bus", "big_blue", "--phase", "glide")
    assert (code, err) == (0, "")
    assert out.startswith("big_blue, phase glide, nothing down; times in ms\n")
    assert re.search(r"^257 +state +flight +20 +0\.540 +0\.68%$", out, re.MULTILINE)
    assert re.search(r"^1884 +CANopen heartbeat +flight +1000 ", out, re.MULTILINE)
    assert "the reserve has room for 110 frames/s more" in out
    assert "response times are computed for wired buses only" in out
    radio = run(capsys, "bus", "big_blue", "--bus", "radio")[1]
    assert "bus can0" not in radio


def test_on_a_terminal_it_is_drawn_with_bars(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "140")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    out = re.sub(r"\x1b\[[0-9;]*m", "", run(capsys, "bus", "elevator_and_chute")[1])
    assert "█░░░░ 0.14% of 70.00%" in out


def test_a_plan_that_was_kept_is_looked_at_in_its_own_situation(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    kept = tmp_path / "plan.json"
    kept.write_text(run(capsys, "plan", "big_blue", "--down", "bus:radio", "--json")[1])
    code, out, _ = run(capsys, "bus", "big_blue", "--plan", str(kept), "--json")
    document = json.loads(out)
    assert (code, document["down"], document["buses"]["radio"]["up"]) == (0, ["bus:radio"], False)
    assert document["buses"]["can0"]["messages"][0]["slack_ns"] == 20_000_000 - 270_000
    assert "is down" in run(capsys, "bus", "big_blue", "--plan", str(kept))[1]


def test_too_much_or_too_late_is_said_and_makes_the_exit_code_1(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    spec, kept = tmp_path / "slow.dg.yaml", tmp_path / "plan.json"
    spec.write_text(SLOW.replace("RATE", "200"))
    running = {n: {"pe": r.pe, "mode": r.mode, "inputs": {}} for n, r in RUNNING.modules.items()}
    running["act"]["inputs"] = {"": {"producer": "look", "variable": "view", "version": 1}}
    kept.write_text(json.dumps({"modules": running}))
    code, out, _ = run(capsys, "bus", str(spec), "--plan", str(kept))
    assert code == 1
    assert "135.00% of 70.00%: TOO MUCH" in out
    assert "no bound" in out
    spec.write_text(SLOW.replace("RATE", "20").replace("200}", "20}"))
    code, out, _ = run(capsys, "bus", str(spec), "--plan", str(kept))
    assert code == 1
    assert re.search(r"^201 +ALIVE +manager +20 +20\.250 > 20 ", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--bus", "can1"), "big_blue has no bus 'can1'; its buses are can0, radio"),
        (("--plan", "PLAN"), "the frames that it puts on the bus cannot be worked out: correct the plan"),
        (("--down", "pe:nowhere"), "no PE is named 'nowhere'"),
    ],
)
def test_what_cannot_be_shown_is_reported_in_one_sentence(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    plan_file = tmp_path / "plan.json"
    plan_file.write_text('{"modules": {"nobody": {"pe": "nav", "mode": "only", "inputs": {}}}}')
    code, out, err = run(capsys, "bus", "big_blue", *(str(plan_file) if a == "PLAN" else a for a in arguments))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert sentence in err


@pytest.mark.parametrize("name", ["big_blue", "elevator_and_chute", *map(str, example_specs())])
@pytest.mark.parametrize("down", [[], ["--down", "bus:radio"]])
def test_it_fits_a_terminal_of_80_columns(capsys: pytest.CaptureFixture[str], name: str, down: list[str]) -> None:
    if down and name != "big_blue":
        return
    code, out, _ = run(capsys, "bus", name, *down)
    assert code == 0
    assert [line for line in out.splitlines() if len(line) > 80] == []


def test_a_line_has_who_sends_how_often_and_how_late(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "bus", "big_blue", "--bus", "can0")
    lines = [line.split() for line in out.splitlines()]
    assert ["id", "message", "from", "period", "worst", "load"] in lines
    assert ["257", "state", "flight", "20", "0.540", "0.68%"] in lines
    assert ["311", "pitch_angle", "nav/attitude_filter", "25", "1.890", "0.54%"] in lines
