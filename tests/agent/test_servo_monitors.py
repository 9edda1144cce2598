"""The servo monitors: a jammed servo is reported, its healthy twin is not, and a sensor does not cost two servos."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.rig import Rig
from heronry_agent.module import Datum
from heronry_tools.aircraft.plant import Plant

RATE_HZ = 40
COMMANDS = ("elevator_demand", "elevator_servo_command")


def swing(tick: int) -> float:
    """A command that moves as in the glide: some degrees, every 8 seconds."""
    return 8.0 * math.sin(math.tau * tick / RATE_HZ / 8.0)


@dataclass
class Tail:
    """Two servos, one surface, one angle sensor, one monitor, and a manager that has chosen the `working` servo.

    The manager uses the other servo a second after the report that this one has failed.
    """

    image: str
    plant: Plant = field(default_factory=lambda: Plant(0))
    working: int = 1
    tick: int = 0
    health: int = 0
    manager_acts: bool = True
    told_at: int | None = None

    def __post_init__(self) -> None:
        self.restart_monitor()

    def restart_monitor(self) -> None:
        self.rig = Rig(self.image, rate_hz=RATE_HZ)

    def fly(self, seconds: float, command: Callable[[int], float] = swing) -> None:
        for _ in range(round(seconds * RATE_HZ)):
            now_ns = self.tick * 1_000_000_000 // RATE_HZ
            angle = command(self.tick)
            self.plant.write(f"elevator_servo_{self.working}", angle, now_ns)
            data = {"elevator_demand": Datum(angle, 1, 0), "elevator_servo_command": Datum(angle, self.working, 0)}
            measured = self.plant.read("elevator_angle_sensor", now_ns)
            if measured is not None:
                data["elevator_angle"] = Datum(measured, 1, 0)
            (self.health,) = self.rig.feed(data).values()
            self.tick += 1
            self._manage()

    def _manage(self) -> None:
        if self.told_at is None and self.reported[-1:] == [f"device:elevator_servo_{self.working}"]:
            self.told_at = self.tick
        elif self.told_at is not None and self.manager_acts and self.tick == self.told_at + RATE_HZ:
            self.working, self.told_at = 3 - self.working, None

    def fail(self, device: str) -> None:
        self.plant.fail(device, "stuck", self.tick * 1_000_000_000 // RATE_HZ)

    @property
    def reported(self) -> list[str]:
        return self.rig.host.reported


BOTH = pytest.mark.parametrize("image", ["servo_monitor", "elevator_monitor"])


@BOTH
def test_a_healthy_servo_is_left_in_peace(image: str) -> None:
    tail = Tail(image)
    tail.fly(60)
    assert (tail.reported, tail.health) == ([], 0)


@BOTH
def test_one_slow_step_reports_no_servo(image: str) -> None:
    """Command and angle are of different moments: at one step a second they may well be far apart once."""
    slow = Rig(image, rate_hz=1)
    for commanded, measured in [(0.0, 0.0), (12.0, 0.0), (12.0, 12.0), (0.0, 12.0), (0.0, 0.0)]:
        slow.feed({name: Datum(commanded, 1, 0) for name in COMMANDS} | {"elevator_angle": Datum(measured, 1, 0)})
    assert slow.host.reported == []


def test_a_monitor_without_an_echo_reports_no_servo_where_no_pe_drives_for_a_second() -> None:
    """The driver's PE is lost, and another one takes its place: all the while the surface stands still."""
    tail = Tail("servo_monitor")
    tail.fly(10)
    tail.working = 0
    tail.fly(1.2)
    tail.working = 2
    tail.fly(10)
    assert (tail.reported, tail.health) == ([], 0)


@BOTH
def test_a_stuck_servo_is_reported_within_seconds(image: str) -> None:
    tail = Tail(image)
    tail.fly(10)
    tail.fail("elevator_servo_1")
    tail.fly(4.5)
    assert (tail.reported, tail.health) == (["device:elevator_servo_1"], 1)


@BOTH
@given(after_s=st.floats(0, 20))
def test_whenever_it_sticks_it_is_reported_before_a_swing_is_over(image: str, after_s: float) -> None:
    tail = Tail(image)
    tail.fly(after_s)
    tail.fail("elevator_servo_1")
    tail.fly(8)
    assert tail.reported == ["device:elevator_servo_1"]


@BOTH
def test_the_detail_tells_the_difference_in_tenths_of_a_degree(image: str) -> None:
    tail = Tail(image)
    tail.fly(3, lambda _: 0.0)
    tail.fail("elevator_servo_1")
    tail.fly(3, lambda _: 12.0)
    ((_, detail),) = tail.rig.host.reports
    assert detail == pytest.approx(120, abs=3)


@BOTH
def test_the_surface_may_stand_anywhere_when_the_monitor_starts(image: str) -> None:
    tail = Tail(image)
    tail.plant.write("elevator_servo_2", -20.0, 0)
    tail.tick = RATE_HZ
    tail.fly(20, lambda _: 20.0)
    assert tail.reported == []


@BOTH
def test_once_the_other_servo_works_all_is_well_again(image: str) -> None:
    tail = Tail(image)
    tail.fly(10)
    tail.fail("elevator_servo_1")
    tail.fly(60)
    assert tail.working == 2
    assert tail.reported == ["device:elevator_servo_1"]


@BOTH
def test_the_second_servo_is_reported_when_it_sticks_later(image: str) -> None:
    tail = Tail(image)
    tail.fly(10)
    tail.fail("elevator_servo_1")
    tail.fly(25)
    tail.fail("elevator_servo_2")
    tail.fly(4)
    assert (tail.reported, tail.health) == (["device:elevator_servo_1", "device:elevator_servo_2"], 2)


@BOTH
def test_a_stuck_angle_sensor_costs_one_servo_and_never_both(image: str) -> None:
    tail = Tail(image)
    tail.fly(10)
    tail.fail("elevator_angle_sensor")
    tail.fly(60)
    assert (tail.reported[0], tail.health) == ("device:elevator_servo_1", 3)
    assert set(tail.reported[1:]) == {"device:elevator_angle_sensor"}


@BOTH
def test_the_same_one_is_reported_again_while_the_manager_has_no_better_idea(image: str) -> None:
    tail = Tail(image, manager_acts=False)
    tail.fail("elevator_servo_1")
    tail.fly(60, lambda tick: swing(tick) + 10.0)
    assert tail.reported.count("device:elevator_servo_1") == (1 if image == "servo_monitor" else 16)
    assert "device:elevator_servo_2" not in tail.reported


@BOTH
def test_without_an_angle_or_a_command_no_servo_is_reported(image: str) -> None:
    tail = Tail(image)
    tail.fly(10)
    tail.plant.fail("elevator_angle_sensor", "dead", 0)
    tail.fail("elevator_servo_1")
    tail.fly(20)
    assert tail.rig.step() in ({"servo_health": 0}, {"servo_failure": 0})
    assert tail.reported == []


def test_told_which_servo_works_the_monitor_blames_the_second_one_after_its_own_restart() -> None:
    tail = Tail("elevator_monitor", working=2)
    tail.fly(10)
    tail.restart_monitor()
    tail.fail("elevator_servo_2")
    tail.fly(8)
    assert tail.reported == ["device:elevator_servo_2"]


def test_not_told_the_paper_s_monitor_starts_with_the_primary_and_then_doubts_the_sensor() -> None:
    """As its file says of a spare that works without its knowledge: the monitor never gives up both servos."""
    tail = Tail("servo_monitor", working=2, manager_acts=False)
    tail.fly(10)
    tail.fail("elevator_servo_2")
    tail.fly(40)
    assert tail.reported[0] == "device:elevator_servo_1"
    assert set(tail.reported[1:]) == {"device:elevator_angle_sensor"}


def test_a_servo_that_was_repaired_and_follows_again_is_forgiven() -> None:
    tail = Tail("elevator_monitor")
    tail.fail("elevator_servo_1")
    tail.fly(8)
    assert (tail.working, tail.health) == (2, 1)
    tail.plant.heal("elevator_servo_1")
    tail.working = 1
    tail.fly(10)
    assert tail.health == 0
