"""Plans made ahead without a file: made once, kept, equal for manager and tables, and never a reason not to fly."""

import fcntl
import io
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.contingency.file_format import to_bytes
from heronry_manager.contingency.journal import Journal, JournalError
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.cli import main
from heronry_tools.console.contingencies_argument import Ahead
from heronry_wire.pe_table import PeTable

CHUTE = load(shipped_spec_path("elevator_and_chute"))
MAKING = (
    "heronry: planning elevator_and_chute ahead for every single fault, once (25 plans, and those of places in use)\n"
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "heronry" / "contingencies"


def kept(cache: Path) -> Path:
    (file,) = cache.glob("elevator_and_chute-*.contingencies")
    return file


def test_single_faults_are_planned_once_and_are_what_the_command_makes(
    cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    assert capsys.readouterr().err == MAKING
    assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS) == first
    assert capsys.readouterr().err == ""
    assert main(["contingencies", "elevator_and_chute", "--faults", "1", "-o", str(tmp_path / "f"), "--jobs", "1"]) == 0
    assert (tmp_path / "f").read_bytes() == kept(cache).read_bytes()
    assert contingencies_of(CHUTE, tmp_path / "f") == first
    assert contingencies_of(CHUTE, Ahead.NOTHING) is None


def test_tables_have_on_board_what_the_manager_calls(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["table", "elevator_and_chute", "tail_pe"]) == 0
    said = capsys.readouterr()
    made = contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    assert made is not None
    assert said.err == MAKING
    assert len(PeTable.from_json(said.out).preloaded()) == len(made.configurations)
    assert main(["table", "elevator_and_chute", "tail_pe", "--contingencies", "none"]) == 0
    assert PeTable.from_json(capsys.readouterr().out).preloaded() == ()


def test_what_is_damaged_is_made_anew(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    assert made is not None
    for damage in (b"", b"x", to_bytes(made, CHUTE)[:-1]):
        kept(cache).write_bytes(damage)
        capsys.readouterr()
        assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS) == made
        assert capsys.readouterr().err == MAKING
        assert kept(cache).read_bytes() == to_bytes(made, CHUTE)


def test_a_killed_run_is_gone_on_with(
    cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("heronry_tools.analysis.campaign.sweeping.numbered", interrupted)
        with pytest.raises(KeyboardInterrupt):
            contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    (partial,) = cache.glob("*.partial")
    capsys.readouterr()
    assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS) is not None
    assert f"heronry: continuing {partial}, which has 17 plans" in capsys.readouterr().err
    assert not partial.exists()


def test_the_second_process_waits_and_takes_what_was_made(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    file = kept(cache)
    data = file.read_bytes()
    file.unlink()
    found: list[object] = []
    said = io.StringIO()  # not capsys: reading it while a thread writes may lose what is written
    monkeypatch.setattr(sys, "stderr", said)
    with (cache / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        second = threading.Thread(target=lambda: found.append(contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)))
        second.start()
        while "waiting for another process that plans ahead" not in said.getvalue():
            assert second.is_alive()
            time.sleep(0.001)
        file.write_bytes(data)
    second.join()
    assert found == [made]


def test_what_cannot_be_kept_is_no_reason_not_to_fly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS) is None
    said = capsys.readouterr().err
    assert said.startswith("heronry: nothing is planned ahead: ")
    assert said.endswith("cannot be written (Not a directory); set XDG_CACHE_HOME to a folder of yours\n")


def test_a_full_disk_is_no_reason_either(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise JournalError("it cannot be written: No space left on device")

    monkeypatch.setattr(Journal, "add", full)
    assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS) is None
    assert capsys.readouterr().err == MAKING + (
        "heronry: nothing is planned ahead: it cannot be written: No space left on device\n"
    )
    assert not list(cache.glob("*.contingencies"))


def test_without_a_solver_tables_carry_nothing_and_it_is_said(tmp_path: Path) -> None:
    code = f"""
import sys
sys.modules["ortools"] = None  # importing it fails
from heronry_tools.cli import main
sys.exit(main(["table", "elevator_and_chute", "tail_pe", "-o", {str(tmp_path / "tail.table")!r}]))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "")
    assert ran.stderr == (
        'heronry: nothing is planned ahead without ortools; add it with: pip install "heronry[manager]"\n'
    )
    assert PeTable.from_json((tmp_path / "tail.table").read_text()).preloaded() == ()


@pytest.mark.parametrize("command", ["manager", "demo"])
def test_a_bus_that_is_not_there_is_reported_before_anything_is_planned(
    command: str, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "elevator_and_chute", "-i", "softbus", "-c", "/no/such.sock"]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert "/no/such.sock" in sentence
    assert not cache.exists()


def test_nothing_is_tried_before_what_is_at_hand(cache: Path) -> None:
    def never() -> None:
        raise AssertionError("it is not called")

    made = contingencies_of(CHUTE, Ahead.SINGLE_FAULTS)
    assert contingencies_of(CHUTE, Ahead.SINGLE_FAULTS, never) == made
