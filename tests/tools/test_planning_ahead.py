"""The process that makes plans behind a demo ends with the demo, in whatever state it is."""

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.shipped import shipped_spec_path
from manager.test_filler_pauses import state_of, until

DEMO_THAT_IS_KILLED = """
import os, signal, sys
from pathlib import Path
from heronry_dg.loader import load
from heronry_tools.runtime.demo.planning_ahead import PlanningAhead
file = Path(sys.argv[1])
behind = PlanningAhead(load(file), file)
behind.start()
behind.pause_if(is_something_under_way=True)
while sys.argv[2] == "stopped" and not behind._is_held:
    behind.pause_if(is_something_under_way=True)
print(behind._process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def adopts_orphans() -> Iterator[None]:
    """Make this process the new parent of orphans: it is of their session, so a stopped one gets no SIGHUP."""
    subreaper, prctl = 36, ctypes.CDLL(None).prctl  # PR_SET_CHILD_SUBREAPER
    prctl(subreaper, 1, 0, 0, 0)
    yield
    prctl(subreaper, 0, 0, 0, 0)


@pytest.mark.usefixtures("adopts_orphans")
@pytest.mark.parametrize("state", ["starting", "stopped"])
def test_a_demo_that_is_killed_leaves_no_process_that_plans(state: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", DEMO_THAT_IS_KILLED, str(shipped_spec_path("elevator_and_chute")), state]
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as demo:
        said, _ = demo.communicate(timeout=120)
    assert demo.returncode == -signal.SIGKILL
    pid = int(said)
    try:
        until(lambda: state_of(pid) is None)
    finally:
        if state_of(pid) is not None:
            os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
