"""Scenario files that the simulator and a software bus fly too, flown by real processes on a SocketCAN vcan0.

A user-mode Linux, on which this mostly runs, is slow (`test_demo_vcan`), and so are heartbeats and rates here.
"""

import json
import subprocess
import sys
from typing import Any

import pytest

from lab.slow_spec import SLOW_SCENARIO
from thoroughness import mostly_soak

pytestmark = pytest.mark.vcan
_MODULES_ACT = "tests/scenarios/modules_act_by_the_clock.scenario"


@pytest.mark.parametrize("file", mostly_soak([SLOW_SCENARIO, _MODULES_ACT], [_MODULES_ACT]))
def test_a_scenario_file_flies_on_vcan(file: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "heronry_tools", "scenario", file, "-i", "socketcan", "-c", "vcan0", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stderr == ""
    told: dict[str, Any] = json.loads(ran.stdout)
    assert all(one["holds"] for one in told["expectations"]), told
    assert told["violations"] == []
    assert ran.returncode == 0
    assert "vcan0" in told["where"]
