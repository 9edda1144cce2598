"""Output that cannot be written: no room, a folder, a device, a link. The user gets one sentence and no partial file.

The flight itself goes on.
"""

import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from heronry_agent.core.vocabulary import Note
from heronry_agent.shell import cli as agent
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events import PeAnswered
from heronry_manager.planner.client import PlannerClient, PlannerError
from heronry_manager.shell.control_place import ControlError
from heronry_manager.shell.control_socket import ControlSocket
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.console.whole_file import write_whole
from heronry_tools.reports.event_printer import print_event, surviving

FULL = Path("/dev/full")  # every write to it fails like one to a full disk


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_device_or_a_folder_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("heronry_tools.analysis.campaign.sweeping.sweep", None)  # no work is begun
    for file, why in (
        (FULL, "not an ordinary file"),
        (tmp_path, "a folder"),
        (tmp_path / "no" / "file", "is not a folder"),
    ):
        assert main(["contingencies", "elevator_and_chute", "--jobs", "1", "-o", str(file)]) == 2
        assert why in capsys.readouterr().err
    assert FULL.is_char_device(), "a draft would have taken its place"
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_a_file(tmp_path: Path) -> None:
    file = tmp_path / "file"
    write_whole(file, b"before")
    with room_for(100), pytest.raises(UserError, match=r"file cannot be written: File too large"):
        write_whole(file, bytes(1000))
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(tmp_path / "link", b"content")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"content"


def test_a_sweep_without_room_for_its_journal_says_so_and_goes_on_later(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "plans"
    command = ["contingencies", "elevator_and_chute", "--faults", "1", "--jobs", "1", "-o", str(file)]
    with room_for(2000):
        assert main(command) == 2
    said = capsys.readouterr().err
    assert "plans.partial cannot be written: File too large; make room" in said
    assert said.count("\n") == 1
    assert main(command) == 0
    assert "continuing" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [file]


def test_nothing_is_left_where_the_work_cannot_begin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["contingencies", "elevator_and_chute", "-o", str(tmp_path / "plans"), "--jobs", "0"]) == 2
    assert "at least one process must plan" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["plan", "render", "dbc"])
def test_no_spec_is_overwritten_by_what_is_made_from_it(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "my.dg.yaml"
    spec.write_text(Path("dg_specs/elevator_and_chute.dg.yaml").read_text())
    before = spec.read_text()
    assert main([command, str(spec), "-o", str(spec)]) == 2
    assert "a file with this ending is a spec" in capsys.readouterr().err
    assert spec.read_text() == before


def test_no_room_for_standard_output(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    full = FULL.open("w")
    monkeypatch.setattr("sys.stdout", full)
    assert main(["explain", "DG001"]) == 2, "less than a buffer, so that the end is where it fails"
    assert "the output cannot be written: No space left on device" in capsys.readouterr().err
    sys.stdout.flush()  # as Python does when it ends
    with pytest.raises(OSError, match="No space"):
        full.close()


def test_a_reader_that_goes_away_is_no_error(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read, write = os.pipe()
    os.close(read)
    pipe = os.fdopen(write, "w")
    monkeypatch.setattr("sys.stdout", pipe)
    assert main(["explain", "DG001"]) == 141
    assert capsys.readouterr().err == ""
    sys.stdout.flush()
    with pytest.raises(BrokenPipeError):
        pipe.close()


def test_a_manager_does_not_end_because_its_events_cannot_be_written(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tell = surviving(print_event)
    full = FULL.open("w")
    with monkeypatch.context() as patch:
        patch.setattr("sys.stdout", full)
        for _ in range(1000):
            tell(PeAnswered(1, "nav"))
    with pytest.raises(OSError, match="No space"):
        full.close()
    said = "heronry: events are dropped until they can be written: No space left on device\n"
    assert capsys.readouterr() == ("", said), "once"
    tell(PeAnswered(2, "nav"))
    assert capsys.readouterr() == ('{"v":1,"t_ns":2,"event":"pe_answered","pe":"nav"}\n', "")


def test_an_agent_does_not_end_because_its_notes_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    full = FULL.open("w")
    with monkeypatch.context() as patch:
        patch.setattr("sys.stderr", full)
        for _ in range(1000):
            agent._print_note(Note("step", "epoch 1 at GO_ALL"))
    with pytest.raises(OSError, match="No space"):
        full.close()


@pytest.mark.parametrize(
    "command",
    [
        "check elevator_and_chute -o out",
        "table elevator_and_chute tail_pe --contingencies none -o out",
        "dbc elevator_and_chute -o out",
        "rules -o out",
        "key out",
        "new out",
    ],
)
def test_where_no_file_can_grow_a_command_ends_in_one_sentence(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with room_for(0):
        assert main(command.split()) == 2
    sentence = capsys.readouterr().err
    assert "File too large" in sentence
    assert sentence.count("\n") == 1
    assert not any(file.stat().st_size for file in tmp_path.rglob("*") if file.is_file())


def test_a_sentence_that_cannot_be_written_leaves_the_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    full = FULL.open("w", buffering=1)
    with monkeypatch.context() as patch:
        patch.setattr("sys.stderr", full)
        assert main(["plan", "no_such_spec"]) == 2
    with pytest.raises(OSError, match="No space"):
        full.close()


def test_where_no_file_can_grow_a_manager_gets_its_socket_and_no_planner(tmp_path: Path) -> None:
    file = shipped_spec_path("elevator_and_chute")
    with room_for(0), ControlSocket(tmp_path / "socket"):
        with pytest.raises(ControlError, match="process unknown"):
            ControlSocket(tmp_path / "socket")
        with pytest.raises(PlannerError, match="cannot be given the spec: File too large"):
            PlannerClient(load(file), file)
