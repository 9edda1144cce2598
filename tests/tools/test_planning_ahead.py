"""The process that makes plans behind a demo ends with the demo, in whatever state it is."""

import os
from pathlib import Path

import pytest

from heronry_dg.shipped import shipped_spec_path
from manager.killed_parents import expect_end_of_helper

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


@pytest.mark.parametrize("state", ["starting", "stopped"])
def test_a_demo_that_is_killed_leaves_no_process_that_plans(state: str, tmp_path: Path) -> None:
    file, environment = shipped_spec_path("elevator_and_chute"), {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    expect_end_of_helper(DEMO_THAT_IS_KILLED, str(file), state, environment=environment)
