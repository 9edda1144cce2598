"""The manager of a flying aircraft is killed: the standby manager takes over, and no function is interrupted."""

import subprocess
import sys
from pathlib import Path

import pytest

from heronry_manager.events import Adopted, Process, Reconfigured, Summary, TakenOver
from heronry_manager.events.reading import events_in
from lab.slow_spec import slow_spec

pytestmark = pytest.mark.live

PATIENCE_S = 120


@pytest.mark.soak  # test_keyed.py has the same take-over in every run, with a key
def test_the_standby_takes_over_from_a_manager_that_was_killed_and_adopts_what_runs(tmp_path: Path) -> None:
    spec = slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=200)  # a busy machine loses no PE
    command = [sys.executable, "-m", "heronry_tools", "demo", str(spec), "--contingencies", "none"]
    done = subprocess.run(
        [*command, "--kill", "manager@2", "--for", "6", "--json"],
        capture_output=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()
    events = list(events_in(done.stdout.splitlines()))
    (killed,) = (one for one in events if isinstance(one, Process) and one.what == "killed")
    (taken,) = (one for one in events if isinstance(one, TakenOver))
    (adopted,) = (one for one in events if isinstance(one, Adopted))
    assert killed.pe == "manager"
    assert (taken.before, taken.term) == (1, 2)
    assert taken.silent_ns >= 1_000_000_000
    epochs = [one.epoch for one in events if isinstance(one, Reconfigured)]
    assert epochs[-1] == adopted.epoch
    (summary,) = (one for one in events if isinstance(one, Summary))
    assert summary.unserved == ()
