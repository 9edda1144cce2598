"""A scenario file, flown by real processes on a SocketCAN vcan0: what it expects comes true.

A user-mode Linux, on which this mostly runs, is slow (`test_demo_vcan`): so are heartbeats and rates, and the times.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from live.slow_spec import slow_spec

pytestmark = pytest.mark.vcan

SCENARIO = """\
# The operator fails the servo's computer; then the one that flies dies, and its modules move.
spec {spec}
at 2s fail pe:tail_pe
expect function:elevator silent within 9s
at 12s kill pe:sensor_pe
expect pe:sensor_pe silent within 5s
expect manager heard throughout
end 20s
"""


def test_a_scenario_file_flies_on_vcan(tmp_path: Path) -> None:
    spec = slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=1000, rates_divided_by=20)
    file = tmp_path / "failed_and_killed.scenario"
    file.write_text(SCENARIO.format(spec=spec))
    ran = subprocess.run(
        [sys.executable, "-m", "heronry_tools.cli", "scenario", str(file), "-i", "socketcan", "-c", "vcan0", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stderr == ""
    told: dict[str, Any] = json.loads(ran.stdout)
    assert [one["holds"] for one in told["expectations"]] == [True] * 3, told
    assert ran.returncode == 0
    assert "vcan0" in told["where"]
