"""The folder of `heronry record`: it opens everywhere, never exceeds its limit, and survives a kill."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.events import HearsNobody
from heronry_tools.cli import main
from heronry_tools.command_lines.record import size
from heronry_tools.console.errors import UserError
from heronry_tools.recording.masterships import read_recording
from heronry_tools.recording.recorded_folder import HEAD
from heronry_tools.sources.recordings import open_recording
from heronry_tools.watch.recorder import Recorder
from heronry_tools.watch.snapshot import Snapshot
from heronry_wire.frame import Frame, LoggedFrame
from watch.flights import big_blue

pytestmark = pytest.mark.xdist_group("big_blue_log")  # it is flown once

FILE = shipped_spec_path("big_blue")
TEXT = FILE.read_bytes()


def recorded(folder: Path, limit_bytes: int = 100_000_000, times: int = 1) -> Path:
    flight = big_blue()
    recorder = Recorder(folder, flight.spec, "manager", TEXT, limit_bytes)
    for _ in range(times):
        frames, events = list(flight.frames), list(flight.events)
        for number in range(40):
            recorder.write(frames[number::40], events[len(events) * number // 40 : len(events) * (number + 1) // 40])
            whole = sum(file.stat().st_size for file in folder.iterdir())
            assert whole <= limit_bytes
    recorder.close()
    return folder


def same(view: Snapshot) -> Snapshot:
    return replace(view, source="log", events=0)


def test_a_folder_gives_the_same_final_snapshot_as_the_flight(tmp_path: Path) -> None:
    opened = open_recording(recorded(tmp_path / "flight"), None)
    assert same(opened.timeline().last()) == same(big_blue().timeline().last())
    assert len(opened.frames) == len(big_blue().frames)
    assert [one.time_ns for one in opened.frames] == [one.time_ns for one in big_blue().frames]


def test_the_oldest_files_go_and_the_rest_still_tells_everything(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "flight", 1_200_000, times=4)
    names = sorted(file.name for file in folder.glob("*.log"))
    assert names[0] > "00000001.log"
    view = open_recording(folder, None).timeline().last()
    known = big_blue().timeline().last()
    assert (view.epoch, view.phase, view.manager.term) == (known.epoch, known.phase, known.manager.term)
    assert {name: module.pe for name, module in view.modules.items()} == {n: m.pe for n, m in known.modules.items()}


def test_replay_and_top_open_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recorded(tmp_path / "flight")
    frames, no_frames = read_recording(folder)
    assert (len(frames), no_frames) == (len(big_blue().frames), 0)
    assert main(["top", "--json", "--log", str(folder)]) == 0
    assert json.loads(capsys.readouterr().out)["epoch"] == big_blue().timeline().last().epoch


def test_another_spec_than_that_of_the_flight_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recorded(tmp_path / "flight")
    events = tmp_path / "events.jsonl"
    events.write_bytes(b"".join(file.read_bytes() for file in sorted(folder.glob("*.jsonl"))))
    for log in (folder, events):
        for command in ("top", "metrics"):
            more = ["--json", "--once"] if command == "top" else []
            assert main([command, "elevator_and_chute", "--log", str(log), *more]) == 2
            assert f"{log} is a flight of 'big_blue' (digest " in capsys.readouterr().err
    assert main(["replay", str(folder), "elevator_and_chute"]) == 2
    assert "has its own spec: leave SPEC out" in capsys.readouterr().err


def test_a_recording_that_is_not_there_or_is_no_recording_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["top", "--log", str(tmp_path / "nowhere"), "--json"]) == 2
    assert "nowhere: No such file or directory; name a log" in capsys.readouterr().err
    assert main(["replay", "my.dg.yaml", str(tmp_path)]) == 2
    assert "my.dg.yaml is a spec, not a recording" in capsys.readouterr().err
    assert main(["replay", str(tmp_path / "flight.log")]) == 2
    assert "does not name its spec" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["record", "big_blue", "-o", "f"], "to watch big_blue on a bus, add -i and -c; to follow the manager on"),
        (["top", "big_blue", "--json"], "to watch big_blue on a bus or in a log, add -i and -c, or --log FILE; to"),
        (["record", "-o", "f", "--of", "x", "-c", "y"], "a manager (--of, --socket) and a bus (-i, -c, --bus): name"),
        (["top", "--json", "--of", "x", "--log", "y"], "and a recording (--log): name only one of them"),
    ],
)
def test_a_view_names_only_the_sources_that_it_has(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert sentence in capsys.readouterr().err


def test_a_line_cut_by_a_kill_is_left_out(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "flight")
    for file in (*folder.glob("*.log"), *folder.glob("*.jsonl")):
        file.write_bytes(file.read_bytes()[:-7])
    assert len(open_recording(folder, None).frames) == len(big_blue().frames) - 1


def test_a_folder_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    flight = big_blue()
    full = recorded(tmp_path / "full")
    with pytest.raises(UserError, match="not empty"):
        Recorder(full, flight.spec, "bus", TEXT, 10**9)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        Recorder(tmp_path / "file" / "x", flight.spec, "bus", TEXT, 10**9)
    head = json.loads((full / HEAD).read_text())
    (full / HEAD).write_text(json.dumps({**head, "v": 9}))
    with pytest.raises(UserError, match="format 9"):
        open_recording(full, None)
    (full / HEAD).write_text("{")
    with pytest.raises(UserError, match="cannot be read"):
        open_recording(full, None)


def test_sizes() -> None:
    assert [size(text) for text in ("1000000", "500M", "2G", "3kB")] == [10**6, 5 * 10**8, 2 * 10**9, 3000]
    with pytest.raises(argparse.ArgumentTypeError, match="not a size"):
        size("much")
    assert main(["record", "-o", "/tmp/x", "--limit", "1M"]) == 2


class _Quiet:
    """A feed of a bus on which two frames and an event come, and then nothing more."""

    spec, spec_file, source = load(FILE), FILE, "bus"

    def __init__(self) -> None:
        self.frames = [LoggedFrame(n, "can0", Frame(0x123, b"")) for n in range(2)]
        self._events = [HearsNobody(1, term=1)]

    def readers(self) -> list[int]:
        return []

    def poll(self) -> list[Any]:
        come, self._events = self._events, []
        if not come:
            self.frames = []
        return come

    def close(self) -> None:
        pass


def test_it_says_where_it_records_and_how_that_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "flight"
    handlers: dict[int, Any] = {}
    monkeypatch.setattr("heronry_tools.commands.record.opened_feed", lambda _arguments: _Quiet())
    monkeypatch.setattr("signal.signal", handlers.__setitem__)
    assert main(["record", "big_blue", "-o", str(folder), "--for", "0.3"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"recording big_blue into {folder}; Ctrl-C ends it",
        f"the time is up: {folder} has the frames (2) and events (1) of 0 s",
    ]
    monkeypatch.setattr("signal.signal", lambda number, handler: handler(number, None))
    assert main(["record", "big_blue", "-o", str(tmp_path / "next")]) == 0
    assert "\nended by a signal: " in capsys.readouterr().out
