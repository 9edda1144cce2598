"""The tracking filter: late images, wrong images, a lost lock, and whether it knows how wrong it is."""

import math
from collections.abc import Mapping
from random import Random

import pytest

from agent.rig import Rig
from heronry_agent.module import Datum, Value
from heronry_tools.fly.avionics.position import TrackedPosition
from heronry_tools.fly.avionics.tracking_filter import BIAS_ELEVATION, BIAS_H, REFUSALS, STATES, H, TrackingFilter, X

CAMERA_M = (100.0, 12.0, 0.3)
STEP_NS = 25_000_000
SPEED = (15.0, 0.2, -1.3)


def seen_rad(place):
    ahead, right, up = CAMERA_M[0] - place[0], place[1] - CAMERA_M[1], place[2] - CAMERA_M[2]
    return math.atan2(right, ahead), math.atan2(up, math.hypot(ahead, right))


class Approach:
    """A straight approach whose images are 200 ms late, in the filter and in truth."""

    def __init__(self, seed=0, *, bias_m=(2.0, -3.0, 5.0), bias_rad=(0.002, -0.001)):
        self.chance, self.bias_m, self.bias_rad = Random(seed), bias_m, bias_rad
        self.place, self.now_ns = [-500.0, 1.0, 45.0], 0
        self.past = [(0, list(self.place))]
        self.has_receiver = True
        self.filter = TrackingFilter(CAMERA_M, self.receiver(), 0)

    def receiver(self):
        return [p + b + self.chance.gauss(0, 0.3) for p, b in zip(self.place, self.bias_m, strict=True)]

    def fly(self, seconds, *, images=True, off_rad=0.0):
        for _ in range(round(seconds * 40)):
            self.now_ns += STEP_NS
            self.place = [p + v * STEP_NS / 1e9 for p, v in zip(self.place, SPEED, strict=True)]
            self.past.append((self.now_ns, list(self.place)))
            self.filter.advance([v + self.chance.gauss(0, 0.1) for v in SPEED], self.now_ns)
            if self.has_receiver and self.now_ns % (4 * STEP_NS) == 0:
                self.filter.use_receiver(self.receiver())
            if images and self.now_ns % (6 * STEP_NS) == 0 and self.now_ns > 200_000_000:
                then = self.past[-9][1]
                angles = [
                    a + b + self.chance.gauss(0, 0.0015) for a, b in zip(seen_rad(then), self.bias_rad, strict=True)
                ]
                self.filter.use_image(angles[0] + off_rad, angles[1] + off_rad, self.now_ns - 200_000_000)
        return self

    def height_error(self):
        return self.filter.state[H] - self.place[H]


def test_images_mend_a_height_that_the_receiver_has_wrong_by_metres():
    approach = Approach().fly(25)
    assert abs(approach.height_error()) < 0.6
    assert approach.filter.state[BIAS_H] == pytest.approx(5.0, abs=0.8)
    assert approach.filter.sigma(H) < 1.0


def test_without_images_the_bias_stays_unknown_and_the_filter_knows_that():
    approach = Approach().fly(25, images=False)
    assert abs(approach.height_error()) > 2.0
    assert approach.filter.sigma(H) > 3.0


@pytest.mark.parametrize(("told_late_ns", "moves_m"), [(200_000_000, 0.0), (0, 0.05)])
def test_a_late_image_is_compared_with_the_position_at_its_exposure(told_late_ns, moves_m):
    """The filter is right, and so is the image: taken for a new one it pulls the height to where the aircraft was."""
    tracking = TrackingFilter(CAMERA_M, (20.0, 0.0, 12.0), 0)
    exposed = None
    for step in range(1, 41):
        tracking.advance((15.0, 0.0, -4.0), step * STEP_NS)
        if step == 32:
            exposed = tuple(tracking.state[:3])
    before = tracking.state[H]
    azimuth, elevation = seen_rad(exposed)
    tracking.use_image(azimuth, elevation, 40 * STEP_NS - told_late_ns)
    assert abs(tracking.state[H] - before) >= moves_m
    assert told_late_ns == 0 or abs(tracking.state[H] - before) < 1e-6


def test_an_outlier_is_refused():
    approach = Approach().fly(20)
    before = list(approach.filter.state)
    azimuth, elevation = seen_rad(approach.place)
    approach.filter.use_image(azimuth + 0.15, elevation - 0.15, approach.now_ns)
    assert approach.filter.state == before
    assert approach.filter.resets == 0


def test_a_lock_on_something_wrong_ends_after_some_refusals():
    approach = Approach().fly(20)
    for i in range(3):
        approach.filter.state[i] += 80.0
    azimuth, elevation = seen_rad(approach.place)
    for _ in range(REFUSALS):
        approach.filter.use_image(azimuth, elevation, approach.now_ns)
    assert approach.filter.resets >= 1
    approach.fly(8)
    assert abs(approach.height_error()) < 2.0


def test_an_image_older_than_the_memory_changes_nothing():
    approach = Approach().fly(10)
    before = list(approach.filter.state)
    approach.filter.use_image(0.0, 0.0, approach.now_ns - 3_000_000_000)
    assert approach.filter.state == before


def test_time_that_stands_still_changes_nothing():
    approach = Approach().fly(1)
    before = list(approach.filter.state)
    approach.filter.advance((100.0, 0.0, 0.0), approach.now_ns)
    assert approach.filter.state == before


def test_the_filter_knows_how_wrong_it_is():
    """Over many approaches the squared error is about the variance that the filter itself holds."""
    squares = []
    for seed in range(12):
        chance = Random(f"{seed} biases")
        bias_m = (chance.gauss(0, 3), chance.gauss(0, 3), chance.choice((-1, 1)) * chance.uniform(3.5, 7))
        approach = Approach(seed, bias_m=bias_m, bias_rad=(chance.gauss(0, 0.003), chance.gauss(0, 0.002))).fly(22)
        truth = (*approach.place, *bias_m, *approach.bias_rad)
        squares.append(
            [(approach.filter.state[i] - truth[i]) ** 2 / approach.filter.covariance[i][i] for i in range(STATES)]
        )
    mean = sum(map(sum, squares)) / len(squares) / STATES
    assert 0.2 < mean < 2.0


def test_the_covariance_stays_symmetric_and_positive():
    approach = Approach().fly(25)
    covariance = approach.filter.covariance
    assert all(covariance[i][j] == covariance[j][i] for i in range(STATES) for j in range(STATES))
    assert all(covariance[i][i] > 0.0 for i in range(STATES))
    assert covariance[BIAS_ELEVATION][BIAS_ELEVATION] <= 0.002**2


SLOPE = math.tan(math.radians(5.0))


def begun_by_sight(place, *, up, off_rad=0.002):
    elevation = seen_rad(place)[1] + off_rad
    return TrackingFilter.by_sight(CAMERA_M, elevation, 0, sinks=up < -0.5)


@pytest.mark.parametrize("ahead_m", [120.0, 200.0, 300.0, 450.0])
@pytest.mark.parametrize("above_m", [-2.0, 0.0, 2.0])
def test_without_a_receiver_it_begins_where_the_aircraft_may_be(ahead_m, above_m):
    """On the slope, near it, and on the level part before it; the filter knows how wrong the beginning may be."""
    height = SLOPE * (ahead_m - 40.0) + above_m
    begun = begun_by_sight((-ahead_m, 2.0, height), up=-1.4)
    assert abs(begun.state[H] - height) < 3 * begun.sigma(H)
    assert abs(begun.state[X] + ahead_m) < 3 * begun.sigma(X)
    level = begun_by_sight((-620.0, 0.0, 45.0), up=0.1)
    assert level.state[X] == pytest.approx(-600.0, abs=60.0)
    assert level.state[H] == pytest.approx(45.0, abs=0.1)


def test_a_beginning_by_sight_becomes_good_enough_to_land():
    errors = []
    for seed in range(5):
        approach = Approach(seed)
        approach.place = [-300.0, 1.0, 25.0]
        approach.past = [(0, list(approach.place))] * 9
        approach.filter = TrackingFilter.by_sight(CAMERA_M, seen_rad(approach.place)[1] + 0.001, 0, sinks=True)
        approach.has_receiver = False
        approach.fly(16)
        errors.append(abs(approach.height_error()))
    assert max(errors) < 1.5


def test_a_filter_that_doubts_itself_a_third_time_reports_itself_and_goes_on() -> None:
    """The images jump from one side to the other every second, which no aircraft does."""
    rig = Rig("eav_tracked_position", mode="tracking", module="tracked_position")
    outputs: Mapping[str, Value] = {}
    resets = []
    for step in range(600):
        side = 900 if step // 40 % 2 else -900
        is_new = step % 4 == 0
        data = {
            "velocity_north": Datum(20.0, 1, 0),
            "velocity_east": Datum(0.0, 1, 0),
            "velocity_up": Datum(-1.0, 1, 0),
            "image_angles": Datum((side, 800), 1, 0 if is_new else 25_000_000 * (step % 4)),
            "image_age": Datum(50, 1, 0 if is_new else 25_000_000 * (step % 4)),
        }
        data |= {f"gps_{axis}": Datum(at, 1, 0) for axis, at in (("x", -400.0), ("y", 0.0), ("height", 32.0))}
        outputs = rig.feed(data)
        assert isinstance(rig.module, TrackedPosition)
        resets.append(0 if rig.module.filter is None else rig.module.filter.resets)
        if resets[-1] < 3:
            assert rig.host.reported == []
    assert resets[-1] >= 3
    assert set(rig.host.reported) == {"module:tracked_position"}
    assert outputs.keys() == {"position_x", "position_y", "height"}


# The state that a checkpoint keeps


def test_a_filter_goes_on_from_its_numbers_as_good_as_it_was():
    approach = Approach().fly(25)
    numbers = approach.filter.numbers()
    assert len(numbers) == 45
    other = TrackingFilter.of_numbers(CAMERA_M, numbers, approach.now_ns)
    assert (other.state, other.covariance, other.resets) == (
        approach.filter.state,
        approach.filter.covariance,
        approach.filter.resets,
    )
    approach.filter = other
    approach.fly(3)
    assert abs(approach.height_error()) < 0.6
    assert approach.filter.sigma(H) < 1.0


def test_a_module_that_moves_carries_an_old_state_forward_by_the_velocity():
    approach = Approach().fly(25)
    here, there = Rig("eav_tracked_position"), Rig("eav_tracked_position")
    assert isinstance(here.module, TrackedPosition)
    assert isinstance(there.module, TrackedPosition)
    assert here.module.save() == ()
    here.module.filter = approach.filter
    state, before = here.module.save(), approach.filter.state[X]
    there.host.now_ns = 10**9
    there.module.restore(state, 400_000_000)
    moving = {
        f"velocity_{axis}": Datum(speed, 1, 0) for axis, speed in zip(("north", "east", "up"), SPEED, strict=True)
    }
    outputs = there.feed(moving)
    assert outputs["position_x"] == pytest.approx(before + 0.4 * SPEED[0])
    assert there.module.filter is not None
    assert there.module.filter.sigma(H) > 0.0


def test_a_filter_that_cannot_be_trusted_is_not_taken_along():
    rig = Rig("eav_tracked_position")
    assert isinstance(rig.module, TrackedPosition)
    rig.module.filter = Approach().filter
    rig.module.filter.resets = 3
    assert rig.module.save() == ()
