"""The clock of printed lines: one local time, whichever clock a time comes from."""

import time

import pytest

from heronry_wire.clock_of_day import time_of_day


@pytest.fixture(autouse=True)
def clocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer that was started 100 s ago, and whose clock of the day shows 12:34:56.789."""
    noon = time.mktime((2026, 6, 1, 12, 34, 56, 0, 0, -1))
    monkeypatch.setattr(time, "time_ns", lambda: int(noon) * 1_000_000_000 + 789_654_321)
    monkeypatch.setattr(time, "monotonic_ns", lambda: 100_000_000_000)


def test_the_present_time_is_the_local_time() -> None:
    assert time_of_day() == time_of_day(100_000_000_000) == "12:34:56.789"


def test_an_earlier_time_of_the_monotonic_clock_is_as_much_earlier() -> None:
    assert time_of_day(39_345_000_000) == "12:33:56.134"
