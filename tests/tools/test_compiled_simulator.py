"""The compiled simulator: another folder, the same frames."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from heronry_tools.errors import UserError
from heronry_tools.simulator.compiled import compile_into, copy_packages, sources

SMALL = (Path("heronry_wire/layout.py"), Path("heronry_tools/simulator/local_clock.py"))
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")


def test_every_file_that_is_compiled_is_there(tmp_path: Path) -> None:
    copy_packages(tmp_path / "new")
    assert [file for file in sources() if not (tmp_path / "new" / file).is_file()] == []


@needs_compiler
def test_a_compiled_part_is_taken_from_the_folder_and_flies_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    compile_into(folder, SMALL)
    script = "import heronry_tools.simulator.local_clock as clock; print(clock.__file__)"
    first = os.environ | {"PYTHONPATH": str(folder)}
    told = subprocess.run([sys.executable, "-c", script], env=first, capture_output=True, text=True, check=True).stdout
    assert told.startswith(str(folder))
    assert told.rstrip().endswith(".so")


def test_what_cannot_be_compiled_leaves_nothing_and_says_why(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    with pytest.raises(UserError, match=r"mypyc failed(?s:.*)no_such_file"):
        compile_into(folder, [Path("heronry_wire/no_such_file.py")])
    assert not folder.exists()


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    with pytest.raises(UserError, match="name another folder"):
        compile_into(tmp_path / "theirs")
    assert (tmp_path / "theirs").is_dir()
