"""`heronry sim` as its user meets it: what it prints, what it exits with, and the command that replays a flight."""

import json
import shlex
from pathlib import Path

import pytest

from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main

ESTIMATOR = "  state_estimator: {"


@pytest.fixture
def raising(tmp_path: Path) -> Path:
    """A spec with a module that raises half a second after its start: the judge, who was not told, sees it blamed."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    file = tmp_path / "raising.dg.yaml"
    file.write_text(text.replace(ESTIMATOR, f'{ESTIMATOR}image: "scenarios.raising:RaisesAfterHalfASecond", '))
    return file


def test_a_flight_is_told_with_its_four_times(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--kill", "pe:tail_pe@0.5", "--seconds", "1"]) == 0
    head, *reconfigurations = capsys.readouterr().out.splitlines()
    assert head.startswith("seed 0: kill tail_pe at 0.5 s (")
    assert len(reconfigurations) == 2
    assert all(name in reconfigurations[1] for name in ("detect", "decide", "distribute", "activate"))
    assert reconfigurations[1].endswith("pe:tail_pe: silent for 3 heartbeat periods")


def test_each_seed_draws_its_own_losses_and_replays_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--runs", "3", "--seconds", "1", "--loss", "0.01", "--json"]) == 0
    flights = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [flight["seed"] for flight in flights] == [0, 1, 2]
    assert len({json.dumps(flight["acts"]) for flight in flights}) == 3
    program, *words = shlex.split(flights[2]["replay"])
    assert program == "heronry"
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == flights[2]


def test_a_violation_is_told_with_the_command_that_replays_it(
    raising: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", str(raising), "--kill", "pe:tail_pe@2", "--seed", "4", "--seconds", "3"]) == 1
    out = capsys.readouterr().out.splitlines()
    assert any("VIOLATION" in line and "module:state_estimator is reported" in line for line in out)
    assert out[-1] == f"  replay with: heronry sim {raising} --seed 4 --seconds 3 --kill pe:tail_pe@2"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--kill", "pe:tail@1"], "did you mean 'tail_pe'"),
        (["--kill", "tail_pe"], "write it as pe:NAME@SECONDS"),
        (["--restore", "pe:tail_pe@1"], "kill and restore in turn"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "elevator_and_chute", *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--seconds", "-1"], "0 to 86400 seconds"),
        (["--loss", "0.9"], "0 to 0.5"),
        (["--runs", "-2"], "0 or more"),
        (["--seed", "x"], "invalid whole_number value"),
    ],
)
def test_a_number_that_makes_no_sense_is_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["sim", "elevator_and_chute", *words])
    assert stopped.value.code == 2
    assert sentence in capsys.readouterr().err


def test_a_module_without_code_cannot_be_simulated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "no_code.dg.yaml"
    text = shipped_spec_path("elevator_and_chute").read_text()
    file.write_text(text.replace(ESTIMATOR, f"{ESTIMATOR}image: state_estimater, "))
    assert main(["sim", str(file)]) == 2
    assert "module state_estimator cannot be simulated" in capsys.readouterr().err
