"""The code of docs/modules.md runs, and behaves as the page says."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from agent.one_pe import MS, SERVO_1, TABLE
from heronry_agent.core.vocabulary import Drive, DriveFailed, Driven, Heard
from heronry_agent.device import DeviceDriver
from heronry_agent.module import Datum
from heronry_agent.shell.devices import DeviceDriverError, Devices
from heronry_agent.shell.module_runner import ModuleRunner, Orders, Result

PAGE = Path(__file__).resolve().parents[2] / "docs" / "modules.md"
FAST = Orders("speed", "my_glider:Speed", "fast", 25 * MS, device="speed_sensor")
SLOW = Orders("speed", "my_glider:Speed", "slow", 100 * MS, device="speed_sensor")
SPEED, UNTIL_NS = 0, 10**18
SERVO = next(module for module in TABLE.modules if module.index == SERVO_1)


@pytest.fixture
def runner() -> Iterator[ModuleRunner]:
    my_glider = sys.modules["my_glider"] = ModuleType("my_glider")
    exec(code_of("class Speed"), vars(my_glider))
    runner = ModuleRunner(lambda: 0)
    assert runner.start(SPEED, FAST, 0) is None
    yield runner
    del sys.modules["my_glider"]


def code_of(what: str) -> str:
    """The block of Python on the page that contains this text."""
    (code,) = (code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if what in code)
    return str(code)


class Bolted:
    """The page's driver on a board in a folder, and the devices of a table on it."""

    def __init__(self, folder: Path) -> None:
        my_board = ModuleType("my_board")
        exec(code_of("class Board"), vars(my_board))
        self.folder, table = folder, replace(TABLE, modules=(SERVO,))
        for file in ("left_raw", "left_enable"):
            (folder / file).write_text("0")
        self.driver: DeviceDriver = my_board.Board(0, folder)
        self.devices = Devices(table, {"left": self.driver})

    def says(self, file: str) -> str:
        return (self.folder / file).read_text()


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


# The device driver


def test_its_channel_is_read_where_the_wire_is_whole(tmp_path: Path) -> None:
    bolted = Bolted(tmp_path)
    (tmp_path / "left_raw").write_text("2500")
    assert bolted.devices.read(SERVO_1, 0) == 2.5
    (tmp_path / "left_raw").write_text("4095")
    assert bolted.devices.read(SERVO_1, 0) is None
    (tmp_path / "left_raw").unlink()
    assert bolted.devices.read(SERVO_1, 0) is None


def test_its_channel_goes_where_it_can_says_so_and_is_made_safe(tmp_path: Path) -> None:
    bolted = Bolted(tmp_path)
    assert bolted.devices.drive(Drive(SERVO_1, 7.0), 0) == Driven(SERVO_1, 4.0)
    assert (bolted.says("left_raw"), bolted.says("left_enable")) == ("4000", "1")
    bolted.devices.make_safe(SERVO_1, 0)
    assert bolted.says("left_enable") == "0"
    assert bolted.devices.drive(Drive(SERVO_1, "up"), 0) == DriveFailed(SERVO_1, "a channel takes volts, not 'up'")


def test_an_input_has_nothing_to_make_safe_and_a_missing_channel_is_told(tmp_path: Path) -> None:
    bolted = Bolted(tmp_path)
    (tmp_path / "left_enable").unlink()
    bolted.devices.make_all_safe(0)
    assert not (tmp_path / "left_enable").exists()
    with pytest.raises(DeviceDriverError, match=r"device right cannot .* LookupError: the board has no channel right"):
        Devices(TABLE, {"left": bolted.driver, "right": bolted.driver})


def test_it_needs_no_echo(tmp_path: Path) -> None:
    bolted = Bolted(tmp_path)
    assert bolted.devices.followed() == frozenset()
    bolted.devices.heard(Heard("rudder", 3.0), 0)
