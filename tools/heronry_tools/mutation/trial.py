"""One mutant against the tests, in a copy of the checkout: nothing of ours is touched.

A trial runs stages of tests, the quick ones first, and ends at the first that fails: that mutant is *killed*. One that
makes a test hang or eat the memory is killed too, after a time that is long for the tests and by a limit on memory. A
mutant that passes every stage *survives*.
"""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from heronry_tools.mutation.mutants import Mutant

Stage = tuple[str, ...]  # arguments of pytest
PACKAGE_FOLDERS = ("dbc", "dg_specs", "pe_agent", "manager", "tools")
_LIMITED = ("sh", "-c", f'ulimit -v {8 << 20} && exec "$@"', "sh")  # KiB: a mutant must not eat the computer's memory


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant; `killed_by` is the test that noticed, None where none did."""

    mutant: Mutant
    killed_by: str | None


class Tree:
    """A copy of a checkout in which one mutant at a time lives."""

    def __init__(self, checkout: Path, place: Path) -> None:
        """Copy what is under version control, as it is in the working folder."""
        self._place = place
        listed = subprocess.run(
            ["git", "-C", checkout, "ls-files", "-z"], capture_output=True, check=True, text=True
        ).stdout
        for name in filter(None, listed.split("\0")):
            if (checkout / name).is_file():
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(checkout / name, place / name)

    def judge(self, mutant: Mutant, stages: Sequence[Stage], timeout_s: float) -> Verdict:
        """Let a mutant live through the stages, `timeout_s` each; the tree is as before afterwards."""
        file = self._place / mutant.file
        source = file.read_bytes()
        file.write_bytes(mutant.applied_to(source))
        try:
            killers = (self._run(stage, timeout_s) for stage in stages)
            return Verdict(mutant, next((killer for killer in killers if killer is not None), None))
        finally:
            file.write_bytes(source)

    def fails(self, stages: Sequence[Stage], timeout_s: float) -> str | None:
        """Run the stages without a mutant; gives the test that fails, None where all pass."""
        return next((killer for stage in stages if (killer := self._run(stage, timeout_s)) is not None), None)

    def _run(self, stage: Stage, timeout_s: float) -> str | None:
        """Give the test that failed."""
        paths = [str(self._place / folder) for folder in PACKAGE_FOLDERS]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
        pytest = ("pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider")
        process = subprocess.Popen(
            [*_LIMITED, sys.executable, "-m", *pytest, *stage],
            cwd=self._place,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            return f"time: more than {timeout_s:.0f} s"
        finally:
            _end(process)
        return None if process.returncode == 0 else _culprit(output)


def _end(process: subprocess.Popen[str]) -> None:
    """End a run with everything that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _culprit(output: str) -> str:
    named = [line for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return named[0].split(" - ")[0].split(maxsplit=1)[1] if named else "the run of the tests itself"
