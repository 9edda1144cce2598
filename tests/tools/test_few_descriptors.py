"""A process that may open almost no files ends in one sentence."""

import subprocess
import sys
from pathlib import Path

HERONRY = Path(sys.executable).with_name("heronry")


def test_a_demo_that_may_open_eight_files_says_so() -> None:
    command = f"ulimit -n 8; exec {HERONRY} demo elevator_and_chute --for 1"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2
    assert ended.stderr == (
        "heronry: Too many open files: this process may open no more; allow more of them with 'ulimit -n'\n"
    )
