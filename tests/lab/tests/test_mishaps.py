"""The campaign `lab.mishaps`: its draws, its look for what is left behind, and a short flight."""

import subprocess
import sys
from pathlib import Path

import pytest

from lab.mishaps import KINDS, drawn, left_behind, main
from thoroughness import part_of


def test_a_seed_draws_the_same_mishaps_again_and_all_kinds_come() -> None:
    mishaps = drawn(7, 60, ["a", "b"])
    assert mishaps == drawn(7, 60, ["a", "b"]) != drawn(8, 60, ["a", "b"])
    assert {mishap.kind for mishap in mishaps} == set(KINDS)


def test_a_folder_and_a_process_that_are_left_are_found(tmp_path: Path) -> None:
    assert left_behind(tmp_path / "gone") == []
    command = [sys.executable, "-c", "print(flush=True); input()", str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert left_behind(tmp_path) == [f"the folder {tmp_path} is left", f"process {process.pid} is left"]


@pytest.mark.live
@pytest.mark.soak
def test_what_was_served_is_served_again_after_each_mishap(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--count", str(part_of(6)), "--seed", "3"]) == 0
    assert "FAILURE" not in capsys.readouterr().err
