"""The folder of a demo: the folder of a process that has ended is removed, that of a running one is not."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from heronry_tools.runtime.demo.fleet import run_folder


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
