"""Scenario files that the simulator and a software bus fly too, flown by real processes on a SocketCAN vcan0.

A user-mode Linux, on which this mostly runs, is slow (`test_demo_vcan`), and so are heartbeats and rates here.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lab.slow_spec import SLOW_SCENARIO
from thoroughness import mostly_soak

pytestmark = pytest.mark.vcan
_MODULES_ACT = "tests/scenarios/modules_act_by_the_clock.scenario"
_ITS_BEGIN = "the begin of it"
_REST = "at 7.6s wait\n"


def begin_of(file: Path, folder: Path) -> Path:
    """Write the first seconds of the scenario in which modules act: one crashes on a PE, and runs on another."""
    head, rest, _ = file.read_text().partition(_REST)
    assert rest
    begin = folder / "begin.scenario"
    begin.write_text(head.replace("spec ", f"spec {file.parent.absolute()}/") + "end 8s\n")
    return begin


@pytest.mark.parametrize("file", mostly_soak([SLOW_SCENARIO, _MODULES_ACT, _ITS_BEGIN], [_ITS_BEGIN]))
def test_a_scenario_file_flies_on_vcan(file: str, tmp_path: Path) -> None:
    if file == _ITS_BEGIN:
        file = str(begin_of(Path(_MODULES_ACT), tmp_path))
    ran = subprocess.run(
        [sys.executable, "-m", "heronry_tools", "scenario", file, "-i", "socketcan", "-c", "vcan0", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stderr == ""
    told: dict[str, Any] = json.loads(ran.stdout)
    assert [one for one in told["expectations"] if not one["holds"]] == []
    assert told["violations"] == []
    assert ran.returncode == 0
    assert "vcan0" in told["where"]
