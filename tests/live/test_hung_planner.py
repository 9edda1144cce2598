"""The planner's process of a standby manager is stopped: the standby takes over, and configures."""

import os
import signal
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_manager import events
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER
from lab.slow_spec import slow_spec

pytestmark = pytest.mark.live


def child_of(parent: int, *words: bytes) -> int:
    """Process-ID of the child whose command line has these words."""
    children = [int(child) for child in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]
    lines = {child: Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0") for child in children}
    (found,) = (child for child, line in lines.items() if set(words) <= set(line))
    return found


@pytest.mark.soak  # in every run test_planner_processes.py replaces a planner that hangs, test_keyed.py has a take-over
def test_a_standby_whose_planner_hangs_takes_over_and_configures(tmp_path: Path) -> None:
    file = slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=200)
    spec = load(file)
    with Fleet(spec, file, run_folder()) as fleet:
        fleet.start_buses(choose(spec, fleet.folder, {}, None, prefer_vcan=False))
        first = AwaitedEvents(fleet, fleet.start_manager(FIRST_MANAGER, standby=True))
        first.wait(events.ManagerStarted)
        standby = AwaitedEvents(fleet, fleet.start_manager(LAST_MANAGER, standby=True))
        standby.wait(events.StandingBy)
        manager = child_of(os.getpid(), b"manager", b"--node", str(LAST_MANAGER).encode())
        os.kill(child_of(manager, b"heronry_manager.planner.service"), signal.SIGSTOP)
        fleet.kill_manager(FIRST_MANAGER)
        for pe in spec.pes:
            fleet.start_pe(pe)
        standby.wait(events.Reconfigured)
