"""Devices with a process of their own: whatever a driver does, the agent goes on, and an actuator ends safely.

The processes are real; files stand for the hardware (`drivers_that_misbehave`).
"""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import groupby, pairwise
from pathlib import Path
from typing import ClassVar

import pytest

from agent.one_pe import SERVO_1, TABLE
from agent.recorded_devices import RecordedDriver
from heronry_agent.device_driver import ActuatorDriver
from heronry_agent.shell.device_processes import driver_process, isolated
from heronry_agent.shell.device_processes.driver_process import Line, _run
from heronry_agent.shell.device_processes.isolated import IsolatedDevice
from heronry_agent.shell.device_processes.judgement import ReadingRule
from heronry_agent.shell.device_processes.orders import DeviceOrders
from heronry_agent.shell.device_processes.shared_block import SharedBlock
from heronry_agent.shell.devices import Devices

MS = 1_000_000
LEASE_NS = 100 * MS
PATIENCE_S = 60.0
TESTS = str(Path(__file__).resolve().parents[1])


class Bench:
    """One device, looked after as the agent's loop does it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.said: list[str] = []
        self.said_ns = 0
        self.device: IsolatedDevice
        (folder / "reading").write_text("1.5")

    def say(self, sentence: str) -> None:
        self.said.append(sentence)
        self.said_ns = time.monotonic_ns()

    def sensor(self, kind: str = "FileSensor", **rule: float) -> "Bench":
        orders = DeviceOrders("probe", False, f"agent.drivers_that_misbehave:{kind}", self._options(), 10 * MS)
        self.device = IsolatedDevice(orders, ReadingRule(200 * MS, **rule), is_exclusive=False, tell=self.say)
        return self

    def servo(self, *, safe: str | float = "release", is_exclusive: bool = False, **more: float) -> "Bench":
        options = self._options() | {key: value for key, value in more.items() if key == "longest_ms"}
        limits = {key: value for key, value in more.items() if key != "longest_ms"}
        kind = "agent.drivers_that_misbehave:FileServo"
        orders = DeviceOrders("servo", True, kind, options, 10 * MS, safe, **limits)
        rule = ReadingRule(200 * MS)
        self.device = IsolatedDevice(orders, rule, is_exclusive=is_exclusive, tell=self.say)
        return self

    def _options(self) -> dict[str, object]:
        return {"folder": str(self.folder)}

    def order(self, what: str) -> None:
        (self.folder / "order").write_text(what)

    def turn(self, exclusive_until_ns: int | None = None) -> int:
        now_ns = time.monotonic_ns()
        self.device.renew(now_ns + LEASE_NS if exclusive_until_ns is None else exclusive_until_ns, LEASE_NS, now_ns)
        self.device.look(now_ns)
        return now_ns

    def until(self, is_so: Callable[[], bool]) -> None:
        """Turn until something is so; fails if that takes too long, for which there is no bound in the product."""
        end_s = time.monotonic() + PATIENCE_S
        while not is_so():
            assert time.monotonic() < end_s, f"{is_so} does not come true; {self.said}"
            self.turn()
            time.sleep(0.005)

    def reads(self) -> object:
        reading = self.device.read(time.monotonic_ns())
        return reading.value if reading.valid else None

    def command(self, value: float) -> object:
        return self.device.command(value, self.turn())

    def register(self) -> str:
        file = self.folder / "register"
        return file.read_text() if file.exists() else ""

    def lines(self) -> list[tuple[int, str]]:
        """What was written to the servo, each with its time in ns."""
        file = self.folder / "writes"
        lines = file.read_text().splitlines() if file.exists() else []
        return [(int(at), value) for at, value in (line.split() for line in lines)]

    def values(self) -> list[str]:
        """What was written to the servo, without repetitions."""
        return [value for value, _ in groupby(value for _, value in self.lines())]

    def opening(self) -> int:
        """The process that last began to open the servo slowly; 0: none."""
        file = self.folder / "opening"
        return int((file.read_text() if file.exists() else "") or 0)

    def failed(self) -> bool:
        return self.device.is_failed(time.monotonic_ns())


def _wait(is_so: Callable[[], bool]) -> None:
    """Wait, without a turn of the loop, until something is so."""
    end_s = time.monotonic() + PATIENCE_S
    while not is_so() and time.monotonic() < end_s:
        time.sleep(0.005)
    assert is_so()


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([TESTS, os.environ.get("PYTHONPATH", "")]))
    bench = Bench(tmp_path)
    yield bench
    (tmp_path / "order").unlink(missing_ok=True)
    bench.device.close()


# Sensors


def test_a_sensor_is_read_in_its_process(bench: Bench) -> None:
    bench.sensor()
    assert bench.reads() is None, "never read, and so nothing, not 0.0"
    assert not bench.failed()
    bench.until(lambda: bench.reads() == 1.5)
    (bench.folder / "reading").write_text("2.5")
    bench.until(lambda: bench.reads() == 2.5)
    assert not bench.failed()


@pytest.mark.parametrize("what", ["nan", "infinite", "far", "old", "future", "nothing"])
def test_what_is_no_valid_reading_is_none_and_a_device_without_any_has_failed(bench: Bench, what: str) -> None:
    bench.sensor(least=-10.0, most=10.0)
    bench.until(lambda: bench.reads() == 1.5)
    bench.order(what)
    bench.until(lambda: bench.failed() and bench.reads() is None)
    assert bench.said == [], "the process goes on"
    bench.order("")
    bench.until(lambda: bench.reads() == 1.5)
    assert not bench.failed()


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("exit", "ended with exit code 9"),
        ("segfault", "was killed by SIGSEGV"),
        ("raise", "ended with exit code 1"),
        ("hang", "hangs, and is ended"),
        ("no value", "ended with exit code 1"),
    ],
)
def test_a_driver_that_ends_or_hangs_is_started_again_and_given_up_after_its_budget(
    bench: Bench, what: str, says: str
) -> None:
    bench.sensor()
    bench.until(lambda: bench.reads() == 1.5)
    bench.order(what)
    bench.until(lambda: any("it is given up" in line for line in bench.said))
    assert bench.failed()
    assert bench.reads() is None
    assert any(says in line for line in bench.said)
    assert [line[-8:] for line in bench.said if "again" in line] == ["(1 of 3)", "(2 of 3)", "(3 of 3)"]


def test_a_driver_that_ended_once_reads_again(bench: Bench) -> None:
    bench.sensor()
    bench.until(lambda: bench.reads() == 1.5)
    os.kill(bench.device.pid or 0, signal.SIGKILL)
    bench.until(lambda: bool(bench.said))
    (bench.folder / "reading").write_text("3.5")
    bench.until(lambda: bench.reads() == 3.5)
    assert bench.said == ["the driver of device probe was killed by SIGKILL; it is started again (1 of 3)"]


def test_a_flood_of_readings_is_read_as_its_newest(bench: Bench) -> None:
    bench.sensor("FloodingSensor")
    bench.until(lambda: bench.reads() == 1.5)
    (bench.folder / "reading").write_text("4.5")
    bench.until(lambda: bench.reads() == 4.5)
    assert not bench.failed()


def test_a_driver_with_wrong_options_is_given_up_at_once(bench: Bench) -> None:
    orders = DeviceOrders("probe", False, "agent.drivers_that_misbehave:FileSensor", {"fodler": "x"}, 10 * MS)
    bench.device = IsolatedDevice(orders, ReadingRule(200 * MS), is_exclusive=False, tell=bench.said.append)
    bench.until(bench.failed)
    assert bench.said == ["the driver of device probe ended with exit code 2; it is given up"]


# Actuators


def test_an_actuator_is_safe_before_its_first_command_and_after_its_last(bench: Bench) -> None:
    bench.servo()
    bench.until(lambda: bench.register() == "released")
    bench.command(5.0)
    bench.until(lambda: bench.register() == "5.0")
    bench.until(lambda: bench.command(6.0) == 6.0)
    bench.device.make_safe(time.monotonic_ns())
    bench.until(lambda: bench.register() == "released")


@pytest.mark.parametrize(("safe", "ends"), [("hold", "5.0"), ("release", "released"), (-3.0, "-3.0")])
def test_an_agent_that_no_longer_renews_leaves_the_safe_action_to_the_process(
    bench: Bench, safe: str | float, ends: str
) -> None:
    bench.servo(safe=safe)
    bench.until(lambda: bench.command(5.0) == 5.0)
    _wait(lambda: bench.register() == ends)  # no turn of the loop: the agent is paused


def test_a_command_that_has_expired_is_not_revived_by_a_later_authorization(bench: Bench) -> None:
    bench.servo(is_exclusive=True)
    bench.until(lambda: bench.command(5.0) == 5.0)
    bench.turn(exclusive_until_ns=time.monotonic_ns() - 1)
    bench.until(lambda: bench.register() == "released")
    writes = (bench.folder / "writes").read_text()
    for _ in range(20):
        bench.turn()
        time.sleep(0.005)
    assert (bench.folder / "writes").read_text() == writes
    assert bench.device.command(7.0, bench.turn(exclusive_until_ns=time.monotonic_ns() - 1)) is None
    bench.command(8.0)
    bench.until(lambda: bench.register() == "8.0")


def test_limits_clip_and_the_rate_limit_slows(bench: Bench) -> None:
    bench.servo(safe=0.0, least=-10.0, most=10.0, per_s=100.0)
    bench.until(lambda: bench.register() == "0.0")
    bench.until(lambda: bench.command(50.0) == 10.0)
    steps = [float(value) for _, value in bench.lines()]
    assert max(steps) == 10.0
    assert len(steps) > 5
    assert all(later - earlier < 2.001 for earlier, later in pairwise(steps)), "20 ms at 100 units/s"


def test_an_output_that_was_on_for_its_longest_time_goes_off_and_stays_off(bench: Bench) -> None:
    bench.servo(safe=0.0, longest_ms=50)
    bench.until(lambda: bench.values() == ["0.0"])
    bench.until(lambda: bench.command(1.0) is not None and bench.values() == ["0.0", "1.0", "0.0"])
    for _ in range(30):
        bench.command(1.0)
        time.sleep(0.005)
    assert bench.values() == ["0.0", "1.0", "0.0"], "the same order does not switch it on again"
    assert not bench.failed(), "it was refused, and that was answered"
    os.kill(bench.device.pid or 0, signal.SIGKILL)
    bench.until(lambda: bool(bench.said))
    bench.until(lambda: len(bench.lines()) > 1 and bench.lines()[-1][0] > bench.said_ns and bench.register() == "0.0")
    bench.command(1.0)
    bench.until(lambda: not bench.device.owes)
    assert bench.register() == "0.0", "nor does a process that has begun anew"
    bench.command(0.0)
    bench.until(lambda: not bench.device.owes)
    bench.command(1.0)
    bench.until(lambda: bench.values()[-3:] == ["0.0", "1.0", "0.0"] and len(bench.values()) == 5)


def test_a_driver_that_was_killed_takes_the_safe_action_first_and_then_the_next_command(bench: Bench) -> None:
    bench.servo()
    bench.until(lambda: bench.command(5.0) == 5.0)
    (bench.folder / "writes").unlink()
    os.kill(bench.device.pid or 0, signal.SIGKILL)
    bench.until(lambda: bool(bench.said))
    bench.until(lambda: bench.command(6.0) == 6.0)
    first, *rest = [value for _, value in bench.lines()]
    assert first == "released"
    assert set(rest) <= {"5.0", "6.0"}


def test_a_driver_that_hangs_in_a_write_is_told_and_one_that_goes_on_is_safe(bench: Bench) -> None:
    bench.servo()
    bench.until(lambda: bench.command(5.0) == 5.0)
    bench.order("hang")
    bench.command(6.0)
    bench.until(bench.failed)
    bench.order("")
    bench.until(lambda: any("hangs" in line for line in bench.said))
    bench.device.make_safe(time.monotonic_ns())
    bench.until(lambda: bench.register() == "released")


def test_a_paused_driver_writes_nothing_but_the_safe_value_when_it_goes_on(bench: Bench) -> None:
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.command(5.0) == 5.0)
    os.kill(bench.device.pid or 0, signal.SIGSTOP)
    bench.command(6.0)
    time.sleep(2 * LEASE_NS / 1e9)  # the agent is paused, too: nothing is renewed
    expired_ns = time.monotonic_ns()
    os.kill(bench.device.pid or 0, signal.SIGCONT)
    _wait(lambda: bench.register() == "-1.0")
    late = [
        line.split()[1]
        for line in (bench.folder / "writes").read_text().splitlines()
        if int(line.split()[0]) > expired_ns
    ]
    # the second: it was stopped between its look at the clock and its write (docs/limits.md)
    assert late in (["-1.0"], ["5.0", "-1.0"])


def test_the_end_in_order_is_safe(bench: Bench) -> None:
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.command(5.0) == 5.0)
    bench.device.close()
    assert bench.register() == "-1.0"
    bench.sensor()  # for the end of the test


def test_a_stopped_branch_is_at_rest_when_its_process_has_taken_the_safe_action(bench: Bench) -> None:
    bench.servo(is_exclusive=True)
    devices = Devices(TABLE, dict.fromkeys(("left", "right"), RecordedDriver(left=bench.device)))  # type: ignore[dict-item, arg-type]
    assert devices.slow_to_rest == {SERVO_1}, "the other one is no real device"
    bench.until(lambda: bench.command(5.0) == 5.0)
    os.kill(bench.device.pid or 0, signal.SIGSTOP)
    devices.look(0, PATIENCE_S * 10**9, time.monotonic_ns())
    devices.make_safe(SERVO_1, time.monotonic_ns())
    assert devices.are_moving
    assert devices.at_rest(time.monotonic_ns()) == []
    os.kill(bench.device.pid or 0, signal.SIGCONT)
    rested: list[int] = []
    bench.until(lambda: bool(rested.extend(devices.at_rest(time.monotonic_ns())) or rested))
    assert (rested, bench.register()) == ([SERVO_1], "released")
    assert not devices.are_moving


def test_a_device_that_never_comes_to_rest_is_awaited_no_longer_than_by_the_core(bench: Bench) -> None:
    bench.servo(is_exclusive=True)
    devices = Devices(TABLE, dict.fromkeys(("left", "right"), RecordedDriver(left=bench.device)))  # type: ignore[dict-item, arg-type]
    bench.until(lambda: bench.command(5.0) == 5.0)
    os.kill(bench.device.pid or 0, signal.SIGSTOP)
    now_ns = time.monotonic_ns()
    devices.look(0, LEASE_NS, now_ns)
    devices.make_safe(SERVO_1, now_ns)
    assert devices.at_rest(now_ns + LEASE_NS - 1) == []
    assert devices.are_moving
    assert devices.at_rest(now_ns + LEASE_NS) == []
    assert not devices.are_moving
    devices.make_safe(SERVO_1, now_ns)
    devices.begun(SERVO_1)
    assert not devices.are_moving


def test_a_command_that_is_no_number_is_refused(bench: Bench) -> None:
    bench.servo()
    with pytest.raises(TypeError, match="device servo moves by a number, not by 'up'"):
        bench.device.command("up", bench.turn())


@pytest.mark.parametrize("when", ["at its start", "while it opens"])
def test_a_process_that_is_ended_before_its_device_is_open_opens_it_and_takes_the_safe_action(
    bench: Bench, when: str
) -> None:
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.command(5.0) == 5.0)
    bench.order("open slowly")
    struck = bench.device.pid or 0
    os.kill(struck, signal.SIGKILL)
    bench.until(lambda: bench.device.pid not in (None, struck))
    if when == "while it opens":
        bench.until(lambda: bench.opening() == bench.device.pid)
    os.kill(bench.device.pid or 0, signal.SIGTERM)
    assert bench.values()[-1] == "5.0"
    bench.order("")
    _wait(lambda: bench.register() == "-1.0")  # no turn of the loop: no successor


AGENT = """
import sys, time
from pathlib import Path
from agent.test_device_processes import Bench

bench = Bench(Path(sys.argv[1])).servo(safe=-1.0)
print(bench.device.pid, flush=True)
while True:
    bench.turn()
    time.sleep(0.005)
"""


@pytest.mark.parametrize("when", ["at its start", "while it opens"])
def test_an_agent_that_dies_before_a_device_is_open_leaves_a_process_that_takes_the_safe_action(
    bench: Bench, when: str
) -> None:
    (bench.folder / "register").write_text("5.0")
    bench.order("open slowly")
    with subprocess.Popen([sys.executable, "-c", AGENT, str(bench.folder)], stdout=subprocess.PIPE, text=True) as agent:
        assert agent.stdout is not None
        driver = int(agent.stdout.readline())
        if when == "while it opens":
            _wait(lambda: bench.opening() == driver)
        agent.kill()
    assert bench.register() == "5.0"
    bench.order("")
    _wait(lambda: bench.register() == "-1.0")
    bench.sensor()  # for the end of the test


def test_an_end_in_order_waits_for_a_device_that_is_being_opened(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolated, "_CLOSES_NS", MS)
    (bench.folder / "register").write_text("5.0")
    bench.order("open slowly")
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.opening() == bench.device.pid)
    later = threading.Timer(0.3, bench.order, [""])
    later.start()
    bench.device.close()
    later.join()
    assert bench.register() == "-1.0"
    bench.sensor()  # for the end of the test


def test_an_end_in_order_does_not_wait_for_a_sensor_that_is_being_opened(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolated, "_CLOSES_NS", MS)
    monkeypatch.setattr(isolated, "_STARTS_NS", int(10 * PATIENCE_S * 1e9))
    bench.order("open slowly")
    bench.sensor("SlowSensor")
    later = threading.Timer(PATIENCE_S, bench.order, [""])
    later.start()
    bench.device.close()
    assert later.is_alive()
    later.cancel()
    bench.sensor()  # for the end of the test


def test_all_devices_take_their_safe_actions_at_the_same_time(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Bench(tmp_path / "other").servo(safe=-1.0)
    other.until(lambda: other.command(5.0) == 5.0)
    bench.order("open slowly")
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.opening() == bench.device.pid)
    devices = Devices(TABLE, dict.fromkeys(("left", "right"), RecordedDriver(left=bench.device, right=other.device)))  # type: ignore[dict-item, arg-type]

    def open_then() -> None:
        _wait(lambda: other.register() == "-1.0")
        bench.order("")

    waits = threading.Thread(target=open_then)
    waits.start()
    devices.close()
    waits.join()
    assert bench.register() == "-1.0"
    bench.sensor()  # for the end of the test


def test_an_end_in_order_beside_a_killed_process_leaves_the_safe_action_to_a_successor(bench: Bench) -> None:
    bench.servo(safe=-1.0)
    bench.until(lambda: bench.command(5.0) == 5.0)
    os.kill(bench.device.pid or 0, signal.SIGKILL)
    bench.device.close()
    assert bench.register() == "-1.0"
    bench.sensor()  # for the end of the test


class CutShortError(Exception):
    """Stands for the exit that the handler of SIGTERM raises, wherever the process is."""


class CutShort(ActuatorDriver):
    """A driver whose first release or so is cut short."""

    cut: ClassVar[int] = 0
    done: ClassVar[int] = 0

    def release(self) -> None:
        """Be cut short, or be complete."""
        type(self).cut -= 1
        if self.cut == 0:
            raise CutShortError
        type(self).done += 1


@pytest.mark.parametrize(("cut", "done"), [(1, 1), (2, 2)])
def test_an_end_by_two_ways_at_once_leaves_a_complete_safe_action_at_the_end(
    cut: int, done: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first release is that of the start; the agent's death closes the socket, and sends SIGTERM as well."""
    own, theirs = socket.socketpair()
    own.close()
    memory = SharedBlock.create()
    block = SharedBlock(memory)
    monkeypatch.setattr(driver_process, "load_driver", lambda _: CutShort)
    monkeypatch.setattr(CutShort, "cut", cut)
    monkeypatch.setattr(CutShort, "done", 0)
    orders = DeviceOrders("servo", True, "cut_short", {}, MS)
    line = Line(theirs.detach())
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(CutShortError):
        _run(orders, block, line)
    line._socket.close()
    assert CutShort.done == done
    block.close()
    os.close(memory)
