"""The benchmark of false alarms and reboots: it counts them, and reports what is false or noticed too late."""

import subprocess
import sys
from contextlib import suppress

import pytest

from heronry_dg.model import Spec
from heronry_tools.sim.flight.simulation import MS
from lab.benches import endurance
from lab.benches.endurance import Reboot, data_plane_off, fly_quietly, fly_reboots, main
from scenarios.flights import elevator_and_chute, two_tails

S = 1_000 * MS


def test_minutes_without_a_fault_and_reboots_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--hours", "0.004", "--reboots", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:2] == ["elevator_and_chute"]
    assert lines[2].startswith("  0.004 h without a fault")
    assert lines[4] == "  0 false alarms"
    assert lines[5] == "  3 reboots inside the window: 100.0% noticed within one heartbeat of the return,"


def test_the_data_plane_is_off_and_the_aircraft_is_the_same_but_for_that() -> None:
    quiet = data_plane_off(elevator_and_chute())
    assert {mode.rate_mhz for module in quiet.modules.values() for mode in module.modes.values()} == {1}
    assert quiet.pes == elevator_and_chute().pes
    assert quiet.digest != elevator_and_chute().digest


def test_reboots_are_short_and_of_every_pe() -> None:
    reboots = fly_reboots(two_tails(), 3)
    assert {reboot.pe for reboot in reboots} == set(two_tails().pes)
    assert all(reboot.away_ns < 35 * MS and reboot.is_in_time for reboot in reboots)


def test_a_bus_that_loses_half_of_what_it_carries_is_full_of_alarms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endurance, "LOSS", 0.5)
    quiet = fly_quietly(two_tails(), (0, 8 * S))
    assert quiet.suspected > 0
    assert any("pe_lost" in line for line in quiet.false)
    assert quiet.stalls > 0


def test_a_reboot_noticed_late_or_never_is_reported_and_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def found(_spec: Spec, _seed: int) -> list[Reboot]:
        return [
            Reboot("in_time", 1, 20 * MS, 20 * MS),
            Reboot("late", 1, 30 * MS, 20 * MS),
            Reboot("never", 1, None, 1),
        ]

    monkeypatch.setattr(endurance, "fly_reboots", found)
    assert main(["--hours", "0", "--reboots", "1"]) == 1
    out = capsys.readouterr().out
    assert "3 reboots inside the window: 33.3%" in out
    assert "the last one after 1.50 heartbeats" in out
    assert "in_time" not in out
    assert "late" in out
    assert "never" in out


def test_a_spec_that_is_not_there_is_one_sentence_and_2() -> None:
    command = (sys.executable, "-m", "lab.benches.endurance", "--spec", "nonsense")
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("endurance: 'nonsense' is neither a file nor a shipped spec")
    assert ended.stderr.count("\n") == 1


def test_the_benchmark_goes_on_compiled_with_that_option(monkeypatch: pytest.MonkeyPatch) -> None:
    gone_on: list[tuple[object, str]] = []
    monkeypatch.setattr(endurance, "go_on_compiled", lambda *arguments: gone_on.append(arguments))
    monkeypatch.setattr(endurance, "fly_reboots", lambda _spec, _seed: [])
    assert main(["--compiled", "--hours", "0", "--reboots", "1"]) == 0
    assert gone_on == [(["--compiled", "--hours", "0", "--reboots", "1"], "lab.benches.endurance")]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["--hours", "0", "--reboots", "0"],
            "--hours 0 with --reboots 0 measures nothing; write more than 0 for one of them",
        ),
        (["--hours", "-1"], "-1 is not a duration; write 0 to 100000 hours"),
        (["--hours", "nan"], "nan is not a duration"),
        (["--hours", "inf"], "inf is not a duration"),
        (["--reboots", "-3"], "-3 is negative; write 0 or more"),
    ],
)
def test_arguments_that_would_measure_nothing_are_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(SystemExit):
        assert main(words) == 2
    assert sentence in capsys.readouterr().err
