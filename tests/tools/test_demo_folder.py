"""The folder of a demo: the folder of a process that has ended is removed, that of a running one is not."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from heronry_tools.runtime.demo.fleet import keep_logs, run_folder
from heronry_tools.runtime.demo.manager_name import manager_name


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def number_of_a_dead_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        return process.pid


def test_only_what_a_dead_run_left_here_is_swept_away(home: Path) -> None:
    own = run_folder()
    here = own.name.rpartition("-")[2]
    dead = number_of_a_dead_process()
    left = home / f"heronry-demo-{dead}-{here}"
    kept = [
        home / f"heronry-demo-{os.getppid()}-{here}",  # it lives
        home / f"heronry-demo-{dead}-01234567",  # a number of another kernel or container that shares this folder
        home / f"heronry-demo-notes-{here}",
    ]
    for folder in (left, *kept):
        (folder / "tables").mkdir(parents=True)
    assert run_folder() == own
    assert sorted(home.iterdir()) == sorted([own, *kept])


def test_no_other_user_may_read_it(home: Path) -> None:
    assert run_folder().stat().st_mode & 0o777 == 0o700


def test_kept_logs_stay_and_only_a_few_runs_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for number in range(8):
        folder = tmp_path / f"heronry-logs-{os.getuid()}-{number}"
        folder.mkdir()
        os.utime(folder, (number, number))
    folder = run_folder()
    (folder / "nav.log").write_text("its last words")
    (folder / "can0.sock").write_text("")
    kept = keep_logs(folder)
    assert [file.name for file in kept.iterdir()] == ["nav.log"]
    assert (kept / "nav.log").read_text() == "its last words"
    left = {one.name.rpartition("-")[2] for one in tmp_path.glob("heronry-logs-*")}
    assert left == {"4", "5", "6", "7", str(os.getpid())}


def test_of_two_demos_of_one_spec_each_has_a_name_and_a_name_is_free_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as runtime:  # its name is short: sockets go into it
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        with manager_name("some") as first:
            with manager_name("some") as second:
                assert (first, second) == ("some-demo", "some-demo-2")
            with manager_name("some") as third:
                assert third == "some-demo-2"
