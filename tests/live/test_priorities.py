"""On one computer a manager comes before its PEs, and its planners do not: late managers lose healthy PEs."""

import os
from pathlib import Path

import pytest

from heronry_manager import events
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from lab.benches.fleets import aircraft
from live.test_hung_planner import child_of

pytestmark = pytest.mark.live


def niceness(process: int) -> int:
    return os.getpriority(os.PRIO_PROCESS, process)


@pytest.mark.skipif(os.geteuid() != 0, reason="the kernel lets privileged users alone give higher priorities")
def test_the_manager_comes_before_its_pes_and_its_planner_does_not() -> None:
    with aircraft("elevator_and_chute") as flown:
        AwaitedEvents(flown.fleet, flown.fleet.start_manager()).wait(events.ManagerStarted)
        manager = child_of(os.getpid(), b"manager", str(flown.fleet.control_socket()).encode())
        planners = [int(one) for one in Path(f"/proc/{manager}/task/{manager}/children").read_text().split()]
        pe = next(iter(flown.start_pes().values()))
        assert niceness(manager) < niceness(pe) <= min(map(niceness, planners))
