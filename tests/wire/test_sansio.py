"""The message of a broken invariant has the facts, with `python -O` too."""

import subprocess
import sys

import pytest

from heronry_wire.sansio import InvariantError, require


def test_what_holds_says_nothing_and_what_does_not_tells_its_story() -> None:
    require(condition=True, story="never told")
    with pytest.raises(InvariantError, match="an epoch number was used twice"):
        require(condition=False, story="an epoch number was used twice")


def test_optimised_python_checks_as_well() -> None:
    program = "from heronry_wire.sansio import require; require(False, 'seen with -O')"
    ended = subprocess.run([sys.executable, "-O", "-c", program], capture_output=True, text=True, check=False)
    assert ended.returncode != 0
    assert "InvariantError: seen with -O" in ended.stderr
