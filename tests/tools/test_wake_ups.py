"""How late this computer lets processes run, and the heartbeat period that follows from it."""

import os
import time
from contextlib import suppress
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_tools.runtime.wake_ups import kept_heartbeat_ns, latest_wake_up_ns, with_heartbeat

MS = 1_000_000


@pytest.mark.parametrize(
    ("late_ms", "period_ms"), [(0, 20), (10, 20), (10.1, 40), (20, 40), (70, 160), (160, 320), (5_000, 320)]
)
def test_a_node_keeps_twice_the_period_that_it_is_late(late_ms: float, period_ms: int) -> None:
    assert kept_heartbeat_ns(round(late_ms * MS)) == period_ms * MS


def test_no_bus_has_a_shorter_heartbeat_and_the_spec_is_the_same_otherwise() -> None:
    spec = load(Path("dg_specs/examples/radio_link.dg.yaml"))
    own = {name: bus.heartbeat_ns for name, bus in spec.buses.items()}
    assert with_heartbeat(spec, 0) == spec
    slower = with_heartbeat(spec, min(own.values()) + 1)
    assert {name: bus.heartbeat_ns for name, bus in slower.buses.items()} == {
        name: max(period_ns, min(own.values()) + 1) for name, period_ns in own.items()
    }
    assert slower.digest == spec.digest


def test_a_rehearsal_gives_the_worst_of_its_processes() -> None:
    begun_ns = time.monotonic_ns()
    assert 0 <= latest_wake_up_ns(3, 0.05) <= time.monotonic_ns() - begun_ns


def test_a_computer_that_stands_still_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    sleep = time.sleep
    monkeypatch.setattr(time, "sleep", lambda wait_s: sleep(wait_s + 0.06))
    assert latest_wake_up_ns(2, 0.5) >= 60 * MS


def test_what_computes_beside_a_rehearsal_ends_with_it() -> None:
    begun_ns, before = time.monotonic_ns(), children()
    assert 0 <= latest_wake_up_ns(2, 0.05, beside=2) <= time.monotonic_ns() - begun_ns
    assert children() == before


def children() -> set[str]:
    """The processes that this one has started and that are left."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended meanwhile
            if status.read_text().rpartition(")")[2].split()[1] == str(os.getpid()):
                found.add(status.parent.name)
    return found
