"""The clock of the day is set by hours and years in flight: no process of the flight notices it.

Setting it needs root, and a Linux of its own: a user-mode Linux, as tools/with-vcan starts it. There processes are slow
(`test_demo_vcan`), and so are the heartbeats here.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread

import pytest

from heronry_manager.events import PeLost, Summary
from heronry_manager.events.reading import events_in
from heronry_tools.runtime.softbus.starter import start_hub
from lab.slow_spec import slow_spec

pytestmark = [
    pytest.mark.vcan,
    pytest.mark.skipif(
        "User Mode Linux" not in Path("/proc/cpuinfo").read_text(), reason="the clock of this computer is not ours"
    ),
]

HOUR_S, YEAR_S = 3_600, 31_536_000
STEPS_S = (HOUR_S, -HOUR_S, YEAR_S, -2 * HOUR_S)
EVERY_S = 2.0


@contextmanager
def clock_of_the_day_being_set() -> Iterator[list[float]]:
    """Set the clock of the day every `EVERY_S`; gives the steps that were made, and puts the clock right at the end."""
    made: list[float] = []
    enough = Event()

    def step() -> None:
        while not enough.wait(EVERY_S):
            made.append(STEPS_S[len(made) % len(STEPS_S)])
            time.clock_settime(time.CLOCK_REALTIME, time.time() + made[-1])

    thread = Thread(target=step)
    thread.start()
    try:
        yield made
    finally:
        enough.set()
        thread.join()
        time.clock_settime(time.CLOCK_REALTIME, time.time() - sum(made))


@pytest.mark.soak  # tests/lab/tests/test_clock_of_the_day.py verifies in every run that nothing that flies reads it
@pytest.mark.parametrize("interface", ["softbus", "socketcan"])
def test_processes_fly_on_while_the_clock_of_the_day_is_set(interface: str, tmp_path: Path) -> None:
    spec = slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=500, rates_divided_by=4)
    command = [sys.executable, "-m", "heronry_tools", "demo", str(spec), "--kill", "pe:control_pe@4", "--json"]
    command += ["--contingencies", "none"]
    with ExitStack() as stack:
        channel = "vcan0"
        if interface == "softbus":
            channel = str(tmp_path / "can0.sock")
            stack.callback(start_hub(channel, 1_000_000).close)
        made = stack.enter_context(clock_of_the_day_being_set())
        bus = ["-i", interface, "-c", channel, "--for", "12"]
        done = subprocess.run([*command, *bus], capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert len(made) >= len(STEPS_S)
    events = list(events_in(done.stdout.splitlines()))
    (summary,) = (one for one in events if isinstance(one, Summary))
    assert summary.unserved == ()
    assert {one.pe for one in events if isinstance(one, PeLost)} <= {"control_pe"}
