"""A few rounds of the campaigns against drivers: all of them end as declared."""

import pytest

from lab.driver_campaigns import ends, strikes
from thoroughness import part_of

pytestmark = pytest.mark.live


def test_actuators_end_safely_whoever_is_paused_or_killed(capsys: pytest.CaptureFixture[str]) -> None:
    assert ends.main(["--number", str(part_of(100, 25))]) == 0, capsys.readouterr().out


def test_struck_drivers_end_as_declared_and_touch_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    assert strikes.main(["--number", str(part_of(500, 60))]) == 0, capsys.readouterr().out
