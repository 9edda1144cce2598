"""A demo that was recorded from a real bus gives the same decisions again."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from heronry_dg.shipped import shipped_spec_path

pytestmark = pytest.mark.live
HERONRY = [sys.executable, "-m", "heronry_tools"]


def test_a_recorded_demo_is_decided_again_as_it_was(tmp_path: Path) -> None:
    """With heartbeats that no computer is too busy for: the recorder and the manager hear the same losses."""
    document = yaml.safe_load(shipped_spec_path("elevator_and_chute").read_text())
    for bus in document["buses"].values():
        bus |= {"heartbeat_ms": 200, "misses": 4}
    spec, log = tmp_path / "slow.dg.yaml", tmp_path / "flight.log"
    spec.write_text(yaml.safe_dump(document, sort_keys=False))
    show = ["--kill", "pe:tail_pe@1", "--restore", "pe:tail_pe@3.5", "--for", "8", "--json", "--record", str(log)]
    show += ["--contingencies", "none"]  # which this spec would make behind the flight
    subprocess.run([*HERONRY, "demo", str(spec), *show], capture_output=True, check=True, timeout=120)
    ran = subprocess.run(
        [*HERONRY, "replay", str(log), str(spec), "--json"], capture_output=True, text=True, check=False, timeout=120
    )
    assert ran.returncode == 0, ran.stdout
    (mastership,) = json.loads(ran.stdout)["masterships"]
    prepared = [entry for entry in mastership["entries"] if entry.get("decision") == "PREPARE"]
    assert len(prepared) >= 3  # the start, the loss, the return; a better plan may have followed one made at once
