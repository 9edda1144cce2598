"""The drivers of docs/devices.md work, and its table names what is shipped."""

import re
from pathlib import Path
from types import ModuleType

import pytest

from heronry_agent.device_driver import Setup, checked_options
from heronry_agent.drivers import SHIPPED
from heronry_agent.shell.driver_catalogue import load_driver

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "devices.md").read_text()


@pytest.fixture
def my_drivers() -> ModuleType:
    module = ModuleType("my_drivers")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(code, vars(module))
    return module


def test_its_thermometer_reads(my_drivers: ModuleType, tmp_path: Path) -> None:
    sensor = my_drivers.Thermometer(Setup("cpu", checked_options(my_drivers.Thermometer.OPTIONS, {}), 1))
    assert str(sensor._file) == "/sys/class/thermal/thermal_zone0/temp"
    sensor._file = tmp_path / "temp"
    sensor._file.write_text("41500\n")
    assert sensor.read() == 41.5


def test_its_lamp_is_commanded_and_released(my_drivers: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "max_brightness").write_text("255\n")
    lamp = my_drivers.Lamp(Setup("lamp", {"folder": str(tmp_path)}, 1))
    assert lamp.command(0.5) == pytest.approx(0.5, abs=0.01)
    assert (tmp_path / "brightness").read_text() == "128"
    lamp.release()
    assert (tmp_path / "brightness").read_text() == "0"


def test_its_table_has_every_shipped_driver_with_every_option() -> None:
    table = PAGE.partition("## Shipped drivers")[2].partition("\n\nA position")[0]
    rows = {row[1].strip(" `"): row[4] for row in (line.split("|") for line in table.splitlines()) if len(row) > 4}
    told = {name: re.findall(r"`(\w+)`", rows[name]) for name in SHIPPED}
    told["iio_out"] = told["iio"]
    assert {name: sorted(options) for name, options in told.items()} == {
        name: sorted(load_driver(name).OPTIONS) for name in SHIPPED
    }
