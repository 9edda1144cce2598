"""When a frame arrived, while somebody sets the clock of the day, or the computer is suspended."""

import time

import can
import pytest

from heronry_wire.arrival_times import ArrivalTimes, StampedMessage

HOUR_NS, YEAR_NS, MS = 3_600_000_000_000, 31_536_000_000_000_000, 1_000_000


class Clocks:
    """Both clocks of a computer; a step moves the clock of the day alone."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns, self.offset_ns = 5_000_000_000, 1_790_000_000_000_000_000
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(time, "time_ns", lambda: self.now_ns + self.offset_ns)

    def arrives(self) -> can.Message:
        """A frame that SocketCAN stamps now."""
        return can.Message(timestamp=(self.now_ns + self.offset_ns) / 1e9)


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    return Clocks(monkeypatch)


@pytest.fixture
def times(clocks: Clocks) -> ArrivalTimes:
    """Of a bus that was read until nothing was left."""
    kept = ArrivalTimes()
    kept.look()
    kept.found_empty()
    return kept


def about(ns: int) -> object:
    return pytest.approx(ns, abs=1000)  # a date in seconds, as a float


def test_a_frame_is_as_old_as_its_stamp(clocks: Clocks, times: ArrivalTimes) -> None:
    clocks.now_ns += 2 * MS
    frame = clocks.arrives()
    clocks.now_ns += 3 * MS
    times.look()
    assert times.age_ns(frame) == about(3 * MS)
    assert times.arrived_ns(frame) == about(clocks.now_ns - 3 * MS)


def test_before_the_first_empty_look_a_frame_may_have_any_age(clocks: Clocks) -> None:
    frame, times = clocks.arrives(), ArrivalTimes()
    clocks.now_ns += HOUR_NS
    times.look()
    assert times.age_ns(frame) == about(HOUR_NS)


def test_a_stamp_of_a_bus_that_knows_needs_no_clock_of_the_day(clocks: Clocks, times: ArrivalTimes) -> None:
    frame = StampedMessage(clocks.now_ns, timestamp=0.0)
    clocks.now_ns += 7 * MS
    clocks.offset_ns += HOUR_NS
    times.look()
    assert times.age_ns(frame) == 7 * MS


@pytest.mark.parametrize("step_ns", [HOUR_NS, YEAR_NS, -HOUR_NS, -YEAR_NS, MS // 2, -MS // 2])
@pytest.mark.parametrize("paused_ns", [0, 20 * MS, 10_000 * MS], ids=lambda ns: f"paused {ns // MS} ms")
def test_no_step_makes_a_frame_newer_or_older_than_the_last_empty_look(
    clocks: Clocks, times: ArrivalTimes, step_ns: int, paused_ns: int
) -> None:
    empty_ns = clocks.now_ns
    stamped = []
    for is_stepping in (False, True, False):
        clocks.now_ns += MS
        clocks.offset_ns += step_ns * is_stepping
        stamped.append((clocks.now_ns, clocks.arrives()))
    clocks.now_ns += paused_ns
    times.look()
    for arrived_ns, frame in stamped:
        assert empty_ns <= times.arrived_ns(frame) <= arrived_ns + 1000


def test_after_a_step_ages_are_right_again_from_the_next_look_but_one(clocks: Clocks, times: ArrivalTimes) -> None:
    clocks.offset_ns -= HOUR_NS
    for _ in range(2):
        times.look()
        times.found_empty()
    frame = clocks.arrives()
    clocks.now_ns += MS
    times.look()
    assert times.age_ns(frame) == about(MS)
