"""The benchmark of reaction times: its aircraft is valid, and its figures are those of the flights."""

import re
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from lab.benches import reaction as reaction_bench
from lab.benches.harness import Report
from lab.benches.reaction import PES, Times, aircraft, main, measure_deaths, tell


def test_the_aircraft_is_written_for_others_to_fly(tmp_path: Path) -> None:
    file = tmp_path / "reaction.dg.yaml"
    assert main(["--write", str(file), "--heartbeat-ms", "5", "--reserve", "0.3"]) == 0
    spec = load(file)
    assert len(spec.pes) == PES
    assert spec.buses["can0"].heartbeat_ns == 5_000_000


def test_deaths_are_measured_reported_and_compared_with_their_limits(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, times = loads(aircraft(20, 0.1), "reaction.dg.yaml"), Times()
    measure_deaths(spec, 3, times)
    assert min(times.reaction) > 45.0  # three heartbeats, less what has passed of the first
    assert min(times.held) > 100.0  # and T_lease
    for limit in ("ONE_STEP_MS", "SEVERAL_STEPS_MS"):
        monkeypatch.setattr(reaction_bench, limit, {20: 1000.0})  # the benchmark measures speed, a test does not
    monkeypatch.setattr(reaction_bench, "REACTION_MS", {20: 1000.0})
    report = Report("reaction", as_json=False)
    tell(spec, times, report)
    assert report.end() == 0
    out = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"8 PEs, 1 Mbit/s, (49|50|51)% load, 20 ms heartbeats, k = 3", out[1])
    counts = {line[:34].strip(): int(line[34:41]) for line in out[3:]}
    assert counts["fault to active"] + counts["fault to active, DEMUX held"] == PES
    monkeypatch.setattr(reaction_bench, "REACTION_MS", {20: 1.0})
    tell(spec, times, report)
    assert report.end() == 1


def test_deciding_is_a_look_up(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reaction_bench, "DECIDE_MS", 1000.0)
    monkeypatch.setattr(reaction_bench, "measure_deaths", lambda _spec, _seed, _times: None)
    assert main(["--flights", "1"]) == 0
    assert "decide (CPU)                          400" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("number", "sentence"), [("0", "0 flights show nothing; write 1 or more"), ("-1", "-1 is negative")]
)
def test_no_flights_are_refused(number: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--flights", number])
    assert stopped.value.code == 2
    assert sentence in capsys.readouterr().err
