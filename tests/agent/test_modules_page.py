"""The code of docs/modules.md runs, and does what the page says."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from agent.one_pe import MS
from heronry_agent.module import Datum
from heronry_agent.shell.module_runner import ModuleRunner, Orders, Result

PAGE = Path(__file__).resolve().parents[2] / "docs" / "modules.md"
FAST = Orders("speed", "my_glider:Speed", "fast", 25 * MS, has_device=True)
SLOW = Orders("speed", "my_glider:Speed", "slow", 100 * MS, has_device=True)
SPEED, UNTIL_NS = 0, 10**18


@pytest.fixture
def runner() -> Iterator[ModuleRunner]:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    my_glider = sys.modules["my_glider"] = ModuleType("my_glider")
    exec(code, vars(my_glider))
    runner = ModuleRunner(lambda: 0)
    assert runner.start(SPEED, FAST, 0) is None
    yield runner
    del sys.modules["my_glider"]


def stepped(runner: ModuleRunner, reading: float | None, density: float | None = 1.225) -> Result:
    inputs = {} if density is None else {"": ("density", Datum(density, 1, 0))}
    result = runner.step(SPEED, 0, UNTIL_NS, reading, inputs)
    assert isinstance(result, Result)
    return result


def test_it_gives_a_speed_where_it_can(runner: ModuleRunner) -> None:
    assert stepped(runner, 2.0).outputs == {"airspeed": pytest.approx(0.5 * (400 / 1.225) ** 0.5)}
    assert stepped(runner, 2.0, density=None).outputs == {}


def test_it_reports_a_sensor_that_does_not_answer_for_as_long_as_that_is_so(runner: ModuleRunner) -> None:
    reports = [stepped(runner, None).reports for _ in range(20)]
    assert reports == [()] * 9 + [(("device:pitot", 0),)] * 11


def test_it_goes_on_in_another_mode(runner: ModuleRunner) -> None:
    before = stepped(runner, 2.0).outputs["airspeed"]
    runner.stop(SPEED, keep=True)
    assert runner.start(SPEED, SLOW, 0) is None
    after = stepped(runner, 2.0).outputs["airspeed"]
    assert isinstance(before, float)
    assert isinstance(after, float)
    assert before < after < 2 * before
