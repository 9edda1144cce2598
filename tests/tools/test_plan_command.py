"""`heronry plan` and `heronry verify` as a user sees them: tables, JSON, exit codes, one sentence for a mistake."""

import io
import json
import re
import sys
from pathlib import Path

import pytest

from heronry_tools.cli import main


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    out, err = capsys.readouterr()
    return code, out, err


def test_a_plan_is_shown_with_what_is_served_where_it_runs_and_what_it_costs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, out, err = run(capsys, "plan", "elevator_and_chute", "--down", "device:gps")
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[0] == "elevator_and_chute, down: device:gps"
    assert lines[1].startswith("the best there is: critical A 100, B 80, C 0, D 20; utility 20000; inputs 2;")
    assert "elevator          A      100       only  100    served by servo_driver_1" in lines
    assert any(line.startswith("sensor_pe") and "pressure_driver" in line for line in lines)
    assert any(line.strip() == "low_quality_altitude" for line in lines)
    assert any(line.startswith("can0") and "1350/700000 bit/s" in line for line in lines)


def test_what_is_not_served_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--down", "pe:tail_pe")
    elevator = next(line for line in out.splitlines() if line.startswith("elevator "))
    assert "NOT SERVED: servo_driver_1 needs device elevator_servo_1 on tail_pe, which is down" in elevator
    assert any(line.startswith("tail_pe") and line.endswith("is down") for line in out.splitlines())


def test_without_the_managers_bus_nothing_can_be_reached(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--down", "bus:can0")
    lines = out.splitlines()
    assert any(line.startswith("sensor_pe") and line.endswith("cannot be reached") for line in lines)
    assert any(line.startswith("can0") and "is down" in line for line in lines)


def test_on_a_terminal_the_same_is_drawn_with_bars(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--down", "pe:tail_pe")
    out = re.sub(r"\x1b\[[0-9;]*m", "", out)
    assert "elevator_and_chute, down: pe:tail_pe" in out
    assert "NOT SERVED:" in out
    assert "███░░ 0.27/0.5" in out
    assert all(len(line) <= 80 for line in out.splitlines())


SMALL = """
dg: 1
name: small
buses: {can0: {bitrate: 125000}}
pes: {only_one: {node_id: 92, buses: [can0], cpu: 1, ram: 10KiB, flash: 10KiB}}
variables: {}
modules:
  first: {cpu: 0.6, ram: 1KiB, rate_hz: 10}
  second: {cpu: 0.6, ram: 1KiB, rate_hz: 10}
  giant: {cpu: 2, ram: 1KiB, rate_hz: 10}
functions:
  first: {output: first, criticality: A}
  second: {output: second}
  giant: {output: giant}
"""


def test_what_never_fits_is_distinguished_from_what_others_have_pushed_out(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "small.dg.yaml"
    file.write_text(SMALL)
    _, out, _ = run(capsys, "plan", str(file), "--json")
    functions = json.loads(out)["functions"]
    assert functions["first"]["served"]
    assert functions["second"]["why_not"] == "it could run alone, but what is served outranks it and leaves no room"
    assert functions["giant"]["why_not"] == "the PEs and buses that are up cannot fit it, even alone"


def test_a_plan_written_as_json_is_legal_where_it_was_made_and_not_elsewhere(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--down", "device:gps", "--json")
    plan = tmp_path / "plan.json"
    plan.write_text(out)
    assert run(capsys, "verify", "elevator_and_chute", str(plan)) == (0, "legal: no rule is broken\n", "")
    code, out, _ = run(capsys, "verify", "elevator_and_chute", str(plan), "--down", "device:barometer")
    assert code == 1
    assert out == "rule 1.device_down, module pressure_driver: the module's device barometer is down\n"
    code, out, _ = run(capsys, "verify", "elevator_and_chute", str(plan), "--limit", "pe:sensor_pe=10%")
    assert code == 1
    assert out.startswith("rule 7.cpu, pe sensor_pe: ")


def test_a_plan_may_come_from_standard_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"modules": {}}'))
    assert run(capsys, "verify", "elevator_and_chute", "-")[0] == 0


def test_the_next_plan_changes_little_of_what_runs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--json")
    now = tmp_path / "now.json"
    now.write_text(out)
    arguments = ("plan", "elevator_and_chute", "--down", "device:elevator_servo_1", "--running", str(now), "--json")
    _, out, _ = run(capsys, *arguments)
    assert json.loads(out)["objective"]["changes"] == 2


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("plan", "nothing"), "'nothing' is neither a file nor a shipped spec"),
        (
            ("plan", "missing.dg.yaml"),
            "missing.dg.yaml:1:1: DG001 error: the file cannot be read: No such file",
        ),
        (("plan", "elevator_and_chute", "--down", "pe:tail"), "no PE is named 'tail'; did you mean 'tail_pe'?"),
        (
            ("plan", "elevator_and_chute", "--down", "tail_pe"),
            "'tail_pe' is not an element; did you mean 'pe:tail_pe'?",
        ),
        (("plan", "elevator_and_chute", "--limit", "bus:can0=140%"), "more than the capacity there is"),
        (("plan", "elevator_and_chute", "--phase", "glide"), "no phase is named 'glide'"),
        (("plan", "elevator_and_chute", "--running", "missing.json"), "missing.json: No such file or directory"),
        (("verify", "elevator_and_chute", "missing.json"), "missing.json: No such file or directory"),
        (("plan", "elevator_and_chute", "--running", "{"), "plan.json: line 1, column 2: this is not JSON"),
        (
            ("plan", "elevator_and_chute", "--running", '{"modules": {"gps": {"pe": "tail_pe", "mode": "only"}}}'),
            "plan.json: modules.gps: the spec has no module 'gps'",
        ),
        (
            ("plan", "elevator_and_chute", "--running", '{"modules": {"gps_driver": {"pe": "tail_pe", "mode": "x"}}}'),
            "plan.json: modules.gps_driver.mode: the module has no mode 'x'",
        ),
        (("verify", "elevator_and_chute", "{}"), "plan.json: the plan has no 'modules'"),
        (("verify", "elevator_and_chute", "[1]"), "must be an object"),
        (("verify", "elevator_and_chute", "\xff"), "is not UTF-8 text; save the file as UTF-8"),
        (("verify", "elevator_and_chute", "\xef\xbb\xbf{}"), "plan.json: the plan has no 'modules'"),
        (("verify", "elevator_and_chute", '{"modules": {}, "down": ["pe:tail"]}'), "did you mean 'tail_pe'"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...], sentence: str
) -> None:
    *others, last = arguments
    if last != "missing.json" and (arguments[0] == "verify" or "--running" in arguments):
        file = tmp_path / "plan.json"
        file.write_bytes(last.encode("latin-1"))
        last = str(file)
    code, out, err = run(capsys, *others, last)
    assert (code, out) == (2, "")
    assert err.startswith("heronry: ")
    assert err.count("\n") == 1
    assert sentence in err


@pytest.mark.parametrize("command", ["plan", "verify"])
def test_help_teaches_by_example(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit) as leaving:
        main([command, "--help"])
    assert leaving.value.code == 0
    assert "examples:" in capsys.readouterr().out


def test_a_plan_against_what_runs_tells_the_way_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    now = tmp_path / "now.json"
    now.write_text(run(capsys, "plan", "big_blue", "--phase", "glide", "--json")[1])
    after = ("plan", "big_blue", "--phase", "glide", "--down", "pe:tail_a", "--running", str(now))
    _, out, _ = run(capsys, *after)
    way = out.splitlines()[-4:]
    assert way[0].startswith("way there  interrupted: elevator, rudder")
    assert way[1].startswith("BREAK      then wait for tail_b (rudder_control moves to comms")
    assert way[2:] == ["GO         then wait T_lease, so that only one PE drives elevator_out", "GO_ALL"]
    document = json.loads(run(capsys, *after, "--json")[1])
    assert document["transition"]["steps"] == ["BREAK", "GO", "GO_ALL"]
    assert document["transition"]["wait_for"].keys() == {"tail_b"}
    assert document["transition"]["hold"] == ["elevator_out"]


def test_a_running_plan_without_wires_is_taken_at_its_worst(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plan = json.loads(run(capsys, "plan", "elevator_and_chute", "--json")[1])
    places = {name: {"pe": running["pe"], "mode": running["mode"]} for name, running in plan["modules"].items()}
    now = tmp_path / "now.json"
    now.write_text(json.dumps({"modules": places}))
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--running", str(now), "--json")
    assert json.loads(out)["transition"]["steps"] == ["GO_ALL"]
    places["gps_driver"]["inputs"] = {"": {"producer": "servo_monitor", "variable": "altitude", "version": 1}}
    now.write_text(json.dumps({"modules": {n: {"inputs": {}, **entry} for n, entry in places.items()}}))
    _, out, _ = run(capsys, "plan", "elevator_and_chute", "--running", str(now), "--json")
    assert json.loads(out)["transition"]["steps"] == ["GO_ALL"]


def test_the_greedy_planner_says_that_it_proves_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "plan", "elevator_and_chute", "--down", "device:gps", "--planner", "greedy")
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[1].startswith("greedy planner: legal, not proven to be the best: critical A 100, B 80, C 0, D 20;")
    assert "elevator          A      100       only  100    served by servo_driver_1" in lines


def test_the_greedy_planners_reasons_are_in_its_document(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "plan", "elevator_and_chute", "--down", "pe:tail_pe", "--planner", "greedy", "--json")
    document = json.loads(out)
    assert code == 0
    assert document["optimal"] is False
    assert {level["bound"] for level in document["levels"]} == {None}
    assert "device elevator_servo_1 on tail_pe, which is down" in document["functions"]["elevator"]["why_not"]


def test_without_a_solver_there_is_the_greedy_planner(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    solving = ("ortools", "heronry_manager.planner.cp_sat", "heronry_manager.planner.exact")
    for module in [name for name in sys.modules if name.startswith(solving)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "ortools", None)
    code, out, err = run(capsys, "plan", "elevator_and_chute")
    assert (code, out) == (2, "")
    assert "ortools, which is not installed; add it with" in err
    assert "use --planner greedy" in err
    assert run(capsys, "plan", "elevator_and_chute", "--planner", "greedy")[0] == 0


def test_a_search_cut_short_says_what_is_proven_and_how_good_the_rest_could_be(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, out, _ = run(capsys, "plan", "big_blue", "--phase", "glide", "--effort", "0")
    proof = out.splitlines()[2]
    assert code == 0
    assert proof.startswith("proven: ")
    assert re.search(r"not proven: .*cpu_millis \d+ \(bound \d+\)", proof)
    _, text, _ = run(capsys, "plan", "big_blue", "--phase", "glide", "--effort", "0", "--json")
    levels = {one["level"]: one for one in json.loads(text)["levels"]}
    assert levels["cpu_millis"]["bound"] <= levels["cpu_millis"]["value"]
    assert not levels["cpu_millis"]["proven"]


@pytest.mark.parametrize("effort", ["-1", "inf", "nan", "much"])
def test_an_effort_that_is_none_is_one_sentence(capsys: pytest.CaptureFixture[str], effort: str) -> None:
    with pytest.raises(SystemExit):
        main(["plan", "big_blue", "--effort", effort])
    assert "--effort" in capsys.readouterr().err
