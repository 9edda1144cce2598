"""A scenario file that the simulator and a software bus fly too, flown by real processes on a SocketCAN vcan0.

A user-mode Linux, on which this mostly runs, is slow (`test_demo_vcan`): so are the heartbeats and rates of its spec.
It is for long runs: in every run the demo shows that processes fly on a vcan, and scenarios on a software bus do.
"""

import json
import subprocess
import sys
from typing import Any

import pytest

from live.slow_spec import SLOW_SCENARIO

pytestmark = [pytest.mark.vcan, pytest.mark.soak]


def test_a_scenario_file_flies_on_vcan() -> None:
    ran = subprocess.run(
        [
            sys.executable,
            "-m",
            "heronry_tools.cli",
            "scenario",
            SLOW_SCENARIO,
            "-i",
            "socketcan",
            "-c",
            "vcan0",
            "--json",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stderr == ""
    told: dict[str, Any] = json.loads(ran.stdout)
    assert [one["holds"] for one in told["expectations"]] == [True] * 5, told
    assert ran.returncode == 0
    assert "vcan0" in told["where"]
