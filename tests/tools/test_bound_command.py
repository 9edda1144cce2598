"""`heronry bound`: the summands of the worst case of a reconfiguration, and cases without a bound."""

import json
import sys
from pathlib import Path

import pytest

from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main

SPLIT = """
dg: 1
name: split
buses:
  can0: {bitrate: 1000000}
  can1: {bitrate: 1000000}
  spare: {bitrate: 1000000}
  islet: {bitrate: 1000000}
manager: {bus: can0}
pes:
  near: {node_id: 92, buses: [can0, spare], cpu: 1, ram: 1MiB, flash: 1MiB}
  gate: {node_id: 93, buses: [can0, can1], cpu: 1, ram: 1MiB, flash: 1MiB}
  far:  {node_id: 94, buses: [can1], cpu: 1, ram: 1MiB, flash: 1MiB}
  castaway: {node_id: 95, buses: [islet], cpu: 1, ram: 1MiB, flash: 1MiB}
devices:
  left: {kind: actuator, pe: near}
  right: {kind: actuator, pe: gate}
  unused: {kind: sensor, pe: near}
variables: {demand: {type: FLOAT}}
gates: {out: {demux: demand}}
modules:
  control: {runs_on: [near, far], gives: {demand: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  drive_left: {device: left, needs: out, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  drive_right: {device: right, needs: out, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {moving: {output: out, criticality: A}}
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(["bound", *arguments])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def split(tmp_path: Path) -> Path:
    spec = tmp_path / "split.dg.yaml"
    spec.write_text(SPLIT)
    return spec


def faults_of(capsys: pytest.CaptureFixture[str], spec: Path) -> dict[tuple[str, str], dict[str, object]]:
    code, out, _ = run(capsys, str(spec), "--decide", "30", "--json")
    document = json.loads(out)
    assert code == 0
    assert document["decide_is"] == "given"
    return {(fault["class"], fault["element"]): fault for fault in document["faults"]}


def test_every_class_is_shown_with_its_worst_element_and_what_it_is_made_of(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, out, err = run(capsys, "elevator_and_chute", "--decide", "30")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "elevator_and_chute: 'decide' is given"
    lost = next(line for line in lines if line.startswith("PE lost, can0")).split()
    total, detect, decide, distribute, activate, lease = map(float, lost[3:9])
    assert total == pytest.approx(detect + decide + distribute + activate + lease, abs=0.3)
    assert (decide, lost[9]) == (30.0, "pe:sensor_pe;")
    assert 65 < detect < 68
    assert {line.split("  ")[0] for line in lines[3:8]} == {
        "PE lost, can0",
        "link partition, can0",
        "PE returns, can0",
        "device reported failed",
        "module reported failed",
    }
    assert lines[-1] == "bus:can0     no PE can be commanded; each PE follows without_manager"


def test_without_a_figure_deciding_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "elevator_and_chute")
    assert out.splitlines()[0].endswith("'decide' is measured on this machine, and all other times are bounds")
    assert json.loads(run(capsys, "elevator_and_chute", "--json")[1])["decide_is"] == "measured"


def test_a_demux_of_a_silent_pe_waits_for_t_lease(capsys: pytest.CaptureFixture[str], split: Path) -> None:
    faults = faults_of(capsys, split)
    near = faults["PE lost", "pe:near"]
    assert near["steps"] == ["GO", "GO_ALL"]
    held = sum(int(str(near[part])) for part in ("decide_ns", "distribute_ns", "lease_wait_ns"))
    assert held == 100_000_000
    assert faults["PE lost", "pe:far"]["note"] == "the running configuration is still the best"
    assert faults["PE lost", "pe:far"]["distribute_ns"] == 0
    assert ("device reported failed", "device:unused") not in faults
    assert "from the report on" in str(faults["device reported failed", "device:left"]["note"])


def test_pes_beyond_a_gateway_are_counted_with_it(capsys: pytest.CaptureFixture[str], split: Path) -> None:
    faults = faults_of(capsys, split)
    assert faults["bus or gateway lost", "pe:gate"] == {
        **faults["PE lost", "pe:gate"],
        "class": "bus or gateway lost",
    }
    assert faults["PE returns", "pe:gate"]["steps"] == ["BREAK", "GO_ALL"]
    assert faults["bus or gateway lost", "bus:spare"]["note"] == "no PE falls silent: the fault is not noticed"
    assert ("PE lost", "pe:castaway") not in faults


def test_a_bus_that_management_alone_fills_has_no_bound(capsys: pytest.CaptureFixture[str], split: Path) -> None:
    split.write_text(SPLIT.replace("can1: {bitrate: 1000000}", "can1: {bitrate: 20000}"))
    code, out, _ = run(capsys, str(split), "--decide", "30")
    assert code == 1
    assert "management frames alone can fill bus can1" in out
    assert "no bound" in out


def test_where_answers_may_be_asked_for_again_there_is_no_bound(
    capsys: pytest.CaptureFixture[str], split: Path
) -> None:
    split.write_text(SPLIT.replace("can1: {bitrate: 1000000}", "can1: {bitrate: 125000, heartbeat_ms: 10}"))
    code, out, _ = run(capsys, str(split), "--decide", "30")
    assert code == 1
    assert "may answer later than a heartbeat period, so that the command is repeated" in out


def test_on_a_terminal_progress_is_shown_and_wiped(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    _, _, err = run(capsys, "elevator_and_chute")
    assert "\r\033[Kplans, at most: 0 of " in err
    assert err.endswith("\r\033[K")


@pytest.mark.parametrize("text", ["-1", "x", "1e9"])
def test_what_is_no_time_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run(capsys, str(shipped_spec_path("big_blue")), f"--decide={text}")
    assert ended.value.code == 2
    assert "--decide" in capsys.readouterr().err
