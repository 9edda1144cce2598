"""`heronry contingencies` as a user sees it: a file, its content, and its verification."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_manager.contingency.contingencies import contingencies
from heronry_manager.contingency.file_format import read_contingencies, to_bytes
from heronry_manager.contingency.journal import Journal
from heronry_manager.planner.safe_mode import safe_mode
from heronry_manager.planner.sweep import Scope, Sweep
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.sweeping import sweep
from heronry_tools.cli import main
from heronry_tools.console.progress import progress_line
from heronry_wire.pe_table import PeTable

CHUTE = load(shipped_spec_path("elevator_and_chute"))


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(["contingencies", *arguments])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A file with all single faults of Figure 3."""
    made = tmp_path / "chute.contingencies"
    assert run(capsys, "elevator_and_chute", "-o", str(made), "--faults", "1", "--jobs", "1")[0] == 0
    return made


def written(scope: Scope, swept: Sweep) -> bytes:
    safe: dict[str | None, Configuration] = {None: safe_mode(CHUTE, None, swept.running(None) or {})}
    return to_bytes(contingencies(CHUTE, scope, swept.outcomes, safe), CHUTE)


def test_a_file_is_made_and_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = tmp_path / "chute.contingencies"
    code, out, err = run(capsys, "elevator_and_chute", "-o", str(made), "--jobs", "1")
    assert (code, err) == (0, "")
    assert f"{made}: {made.stat().st_size} bytes, for elevator_and_chute" in out
    assert "306 plans for up to 2 faults of 24 elements and of the places in use, and 1 for safe mode" in out
    shares = (
        r"[78]\d\.\d% found without a search: \d+ because the plan for one fault fewer stays the best, "
        r"\d+ because another fault has the same"
    )
    assert re.search(rf"\d+ plans searched for, {shares} effect", out)
    assert "0 plans not proven to be the best" in out
    assert re.search(r"PE tail_pe: \d+ configurations on board, \d+ of 4096 bytes", out)
    assert list(tmp_path.iterdir()) == [made], "no journal is left, and no draft"


def test_every_entry_passes_the_verifier(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--check", str(file), "elevator_and_chute", "--jobs", "1")
    assert code == 0
    assert out == "30 plans and 1 for safe mode: all are legal; the values of the 30 plans are as in the file\n"


def test_an_entry_that_is_wrong_is_named(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What runs when nothing is down is claimed to be the plan for a dead PE, too."""
    scope = Scope(("pe:tail_pe",), 1, (None,))
    with crew(1) as nobody:
        swept = sweep(CHUTE, scope, nobody)
    swept.outcomes[None, frozenset({"pe:tail_pe"})] = swept.outcomes[None, frozenset()]
    file.write_bytes(written(scope, swept))
    code, out, _ = run(capsys, "--check", str(file), "elevator_and_chute", "--jobs", "1")
    assert code == 1
    assert "pe:tail_pe: rule 1.pe_down, module servo_driver_1" in out


def test_a_worth_that_is_wrong_is_named(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scope = Scope((), 0, (None,))
    with crew(1) as nobody:
        swept = sweep(CHUTE, scope, nobody)
        elsewhere = sweep(CHUTE, Scope(("device:gps",), 1, (None,)), nobody).outcomes[None, frozenset({"device:gps"})]
    healthy = swept.outcomes[None, frozenset()]
    swept.outcomes[None, frozenset()] = replace(healthy, objective=elsewhere.objective)
    file.write_bytes(written(scope, swept))
    code, out, _ = run(capsys, "--check", str(file), "elevator_and_chute", "--jobs", "1")
    assert (code, out) == (1, "nothing down: the value of this plan is not the value in the file\n")


def test_a_run_goes_on_from_what_an_earlier_one_left(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = file.read_bytes()
    scope = Scope(elements(CHUTE), 1, (None,))
    with Journal(file.with_name(f"{file.name}.partial"), CHUTE, scope) as journal, crew(1) as nobody:
        sweep(CHUTE, Scope(elements(CHUTE), 0, (None,)), nobody, journal)
    file.unlink()
    code, _, err = run(capsys, "elevator_and_chute", "-o", str(file), "--faults", "1", "--jobs", "1")
    assert (code, err) == (0, f"heronry: continuing {file}.partial, which has 1 plans\n")
    assert file.read_bytes() == whole


def test_ctrl_c_tells_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("heronry_tools.analysis.campaign.sweeping.answers", interrupted)
    file = tmp_path / "chute.contingencies"
    code, _, err = run(capsys, "elevator_and_chute", "-o", str(file), "--jobs", "1")
    assert (code, err) == (130, f"heronry: stopped; the same command continues from {file}.partial\n")


def test_verifying_a_file_needs_no_solver(file: Path) -> None:
    """On a node that flies on a table and the greedy planner, without ortools."""
    code = f"""
import sys
sys.modules["ortools"] = None  # importing it fails
from heronry_tools.cli import main
sys.exit(main(["contingencies", "--check", {str(file)!r}, "elevator_and_chute", "--jobs", "1"]))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert re.search(r": all are legal; the values of the \d+ plans are as in the file\n", ran.stdout)


def test_kinds_and_phases_restrict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = tmp_path / "f"
    code, out, _ = run(capsys, "elevator_and_chute", "-o", str(made), "--kinds", "pe, bus", "--jobs", "1")
    assert code == 0
    assert "11 plans for up to 2 faults of 4 elements" in out
    assert read_contingencies(made, CHUTE).scope.elements[-1] == "bus:can0"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["elevator_and_chute"], "one of the arguments -o/--output --check is required"),
        (["elevator_and_chute", "-o", "FILE", "--faults", "-1"], "write how many faults may be present at"),
        (
            ["elevator_and_chute", "-o", "FILE", "--faults", "99"],
            "there are 16777216 sets of faults, and at most 10000000 are",
        ),
        (["elevator_and_chute", "-o", "FILE", "--jobs", "0"], "at least one process must plan"),
        (["elevator_and_chute", "-o", "FILE", "--kinds", "pes"], "'pes' is no kind of element; the kinds are pe, "),
        (["elevator_and_chute", "-o", "FILE", "--phase", "glide"], "no phase is named 'glide'"),
        (["elevator_and_chute", "-o", "missing/FILE"], "missing is not a folder; make this folder first"),
        (["big_blue", "--check", "FILE"], "another spec, or another version of spec big_blue"),
        (["elevator_and_chute", "--check", "missing"], "No such file"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(file.parent)
        file.rename(file.with_name("FILE"))
        try:
            code = main(["contingencies", *arguments])
        except SystemExit as usage:  # argparse
            code = int(usage.code or 0)
    assert code == 2
    assert sentence in capsys.readouterr().err


def test_a_manager_refuses_a_file_of_another_spec(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["manager", "big_blue", "-i", "virtual", "-c", "x"], ["demo", "big_blue"]):
        assert main([*command, "--contingencies", str(file)]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "the file was made for another spec, or another version of spec big_blue; make it anew" in said


def test_how_far_it_is_and_how_long_it_will_take() -> None:
    assert progress_line("plans", 0, 10, 0.0) == "plans: 0 of 10"
    assert progress_line("plans", 10, 100, 10.0) == "plans: 10 of 100, 1:30 left"
    assert progress_line("plans", 100, 100, 10.0) == "plans: 100 of 100"


def test_tables_take_what_fits_on_board(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["table", "elevator_and_chute", "--all", str(tmp_path), "--contingencies", str(file)]) == 0
    held = {pe: PeTable.from_json((tmp_path / f"{pe}.table").read_text()).preloaded() for pe in CHUTE.pes}
    made = read_contingencies(file, CHUTE)
    assert {len(slices) for slices in held.values()} == {len(made.configurations)}
    assert main(["table", "elevator_and_chute", "tail_pe", "--contingencies", str(file)]) == 0
    assert capsys.readouterr().out == (tmp_path / "tail_pe.table").read_text()


def test_what_was_made_and_what_is_wrong_for_a_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = tmp_path / "chute.contingencies"
    words = ("--faults", "1", "--jobs", "1", "--json")
    code, out, _ = run(capsys, "elevator_and_chute", "-o", str(made), *words)
    told = json.loads(out)
    assert (code, told["file"], told["bytes"]) == (0, str(made), made.stat().st_size)
    assert (told["plans"], told["faults"], told["not_proven"]) == (30, 1, 0)
    assert told["on_board"]["tail_pe"]["configurations"] > 0
    code, out, _ = run(capsys, "--check", str(made), "elevator_and_chute", *words)
    assert (code, json.loads(out)) == (0, {"correct": True, "plans": 30, "wrong": []})
