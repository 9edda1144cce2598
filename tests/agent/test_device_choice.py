"""Which driver a device has: that of the node's file, that of the spec, or none, which ends the start."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from agent.one_pe import TABLE
from heronry_agent.shell.cli import main
from heronry_agent.shell.device_choice import DeviceChoiceError, RealDriver, choose_drivers, read_devices
from heronry_agent.shell.device_processes.isolated import IsolatedDriver
from heronry_agent.shell.devices import open_drivers
from heronry_agent.shell.driver_catalogue import UnknownDriverError
from heronry_wire.pe_table import DriverEntry, PeTable, TableError

MS = 1_000_000
LEFT = DriverEntry("left", "pwm", '{"output": 1}', 100 * MS, -25.0, 25.0, 60.0, 0.0)
RIGHT = replace(LEFT, device="right", driver=None, options="{}", safe="hold")
NAMED = replace(TABLE, drivers=(LEFT, RIGHT))


def test_the_file_of_the_node_counts_before_the_spec_and_the_simulation_fills_the_rest() -> None:
    gpio = RealDriver("gpio", {"line": 4, "longest_ms": 9})
    assert choose_drivers(NAMED, {"right": gpio}, simulated=False) == {
        "left": RealDriver("pwm", {"output": 1}), "right": gpio,
    }  # fmt: skip
    assert choose_drivers(NAMED, {"left": gpio}, simulated=True) == {"left": gpio, "right": None}
    assert choose_drivers(NAMED, {}, simulated=True) == {"left": None, "right": None}


def test_a_device_without_a_driver_is_never_simulated_by_accident() -> None:
    with pytest.raises(DeviceChoiceError, match=r"^device right has no driver: name one in the spec or in --devices"):
        choose_drivers(NAMED, {}, simulated=False)


@pytest.mark.parametrize(
    ("named", "says"),
    [
        ({"lift": RealDriver("pwm")}, "the spec has no device 'lift'; did you mean 'left'?"),
        ({"left": RealDriver("pmw")}, "device left: there is no driver 'pmw'; did you mean 'pwm'?"),
        ({"left": RealDriver("my_rig:Servo")}, "device left: driver 'my_rig:Servo': there is no my_rig here"),
    ],
)
def test_a_choice_that_cannot_be_made_is_one_sentence(named: dict[str, RealDriver], says: str) -> None:
    with pytest.raises((DeviceChoiceError, UnknownDriverError)) as refused:
        choose_drivers(NAMED, named, simulated=True)
    assert str(refused.value).startswith(says)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", "this is not JSON"),
        ("[]", "this is not a JSON object"),
        ('{"gps": "nmea"}', "the entry of device 'gps' cannot be read"),
        ('{"gps": {"driver": "nmea", "option": {}}}', "the entry of device 'gps' cannot be read"),
        ('{"gps": {"driver": "nmea", "options": []}}', "the entry of device 'gps' cannot be read"),
        (None, "No such file or directory"),
    ],
)
def test_a_file_of_devices_that_cannot_be_read_is_one_sentence(tmp_path: Path, content: str | None, says: str) -> None:
    file = tmp_path / "devices.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(DeviceChoiceError, match=says):
        read_devices(file)


def test_an_agent_tells_before_it_touches_a_bus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, devices = tmp_path / "tail.table", tmp_path / "devices.json"
    table.write_text(NAMED.to_json())
    devices.write_text(json.dumps({"right": {"driver": "pwn"}}))
    arguments = ["--table", str(table), "-i", "softbus", "-c", "/no/such.sock"]
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith("pe-agent: device right has no driver: name one in the spec")
    assert main([*arguments, "--devices", str(devices)]) == 2
    assert capsys.readouterr().err == "pe-agent: device right: there is no driver 'pwn'; did you mean 'pwm'?\n"


def test_real_and_simulated_devices_stand_side_by_side() -> None:
    drivers = open_drivers(NAMED, 5, {"left": RealDriver("pwm"), "right": None})
    assert isinstance(drivers["left"], IsolatedDriver)
    assert not isinstance(drivers["right"], IsolatedDriver)


# In the table


def test_what_a_table_says_of_drivers_is_read_again() -> None:
    assert PeTable.from_json(NAMED.to_json()) == NAMED
    assert NAMED.identity == TABLE.identity, "an older minor knows none of it"


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (replace(LEFT, device="lift"), "unknown device lift"),
        (replace(LEFT, stale_ns=0), "may be 0 ns old"),
        (replace(LEFT, per_s=0.0), "moves by 0.0 units a second"),
        (replace(LEFT, safe="off"), "has the safe action 'off'"),
        (replace(LEFT, options="[]"), "are not a JSON object"),
        (replace(LEFT, options="{"), "are not a JSON object"),
    ],
)
def test_a_table_that_contradicts_itself_about_a_driver_is_refused(entry: DriverEntry, says: str) -> None:
    with pytest.raises(TableError, match=says):
        PeTable.from_json(replace(TABLE, drivers=(entry,)).to_json())
