"""The benchmarks that fly processes: what they read of events and processes, and a short flight of each."""

import os
from time import monotonic_ns

import pytest

from heronry_dg.loader import loads
from heronry_manager import events
from lab.benches import kills, many_pes
from lab.benches.kills import Kill, Quarter
from lab.benches.processes import busy_s, busy_share, children, open_descriptors


def test_a_kill_is_answered_by_what_is_settled_after_its_loss() -> None:
    quarter = Quarter()
    kill = Kill("wing", quarter)
    done = events.Reconfigured(kill.killed_ns + 90, 2, ("x",), events.Times(1, 1, 20, 10), (), (), ())
    kill.take(done)  # of a change before
    kill.take(events.PeLost(kill.killed_ns + 40, "air", "silent", None))
    kill.take(done)
    assert not kill.is_answered
    kill.take(events.PeLost(kill.killed_ns + 50, "wing", "silent", None))
    kill.take(done)
    kill.take(done)
    assert kill.is_answered
    found = {name: [round(1e6 * ms) for ms in values] for name, values in quarter.times_ms.items()}
    assert found == {"fault to active": [90], "detect": [50], "decision to active": [30]}


def test_a_loss_that_changes_no_plan_is_an_answer_without_times() -> None:
    quarter = Quarter()
    kill = Kill("wing", quarter)
    kill.take(events.PeLost(monotonic_ns(), "wing", "silent", None))
    kill.take(events.PlanUnchanged(monotonic_ns(), 2))
    assert kill.is_answered
    assert not any(quarter.times_ms.values())


def test_the_spec_of_many_pes_is_legal_and_has_a_function_on_each() -> None:
    spec = loads(many_pes.spec_text(34, 20), "many")
    assert (len(spec.pes), len(spec.functions)) == (34, 34)
    assert spec.buses["can0"].heartbeat_ns == 20_000_000


def test_processes_are_read_from_proc() -> None:
    before_s = busy_s()
    while busy_s()[0] == before_s[0]:
        pass
    assert 0 < busy_share(before_s) <= 1
    count = open_descriptors(os.getpid())
    read, write = os.pipe()
    assert open_descriptors(os.getpid()) == count + 2
    os.close(read)
    os.close(write)
    assert os.getpid() not in children(os.getpid())


@pytest.mark.live
@pytest.mark.soak
def test_a_short_flight_with_kills() -> None:
    assert kills.main(["--minutes", "0.3", "--every", "4", "--spec", "elevator_and_chute"]) == 0


@pytest.mark.live
@pytest.mark.soak
def test_a_start_of_a_few_pes() -> None:
    assert many_pes.main(["--pes", "3", "--heartbeats", "200"]) == 0
