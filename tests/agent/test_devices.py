"""Between modules and devices: which devices are opened, what a module reads, when a device is made safe."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from agent.installed_package import install
from agent.one_pe import CONTROL, FLYING, MS, RUN_CONTROL, SERVO_1, SERVO_2, TABLE, OnePe
from agent.recorded_devices import RecordedDevice, RecordedDriver
from heronry_agent.core.vocabulary import Drive, DriveFailed, Driven, Heard, PartitionEnded, StopModule
from heronry_agent.device import DeviceDriver, Reading
from heronry_agent.module import Value
from heronry_agent.shell.device_choice import choose_drivers
from heronry_agent.shell.devices import PLANT, DeviceDriverError, Devices, find_device_driver, open_drivers
from heronry_tools.aircraft.plant import Plant
from heronry_wire.configuration_slice import Slice

GROUP = "heronry.devices"
SIMULATED = dict.fromkeys(("left", "right"))
GROUNDED = replace(TABLE, modules=tuple(module for module in TABLE.modules if module.device is None))


def bolted(**devices: RecordedDevice) -> tuple[Devices, RecordedDriver]:
    """The devices of the table's two servos, on one driver."""
    driver = RecordedDriver(**devices)
    return Devices(TABLE, {"left": driver, "right": driver}), driver


# Which driver has a device


def test_the_message_about_an_unknown_driver_names_the_installed_ones() -> None:
    with pytest.raises(DeviceDriverError, match=r"no device driver is named 'plnat'; installed are: flight, plant"):
        find_device_driver("plnat")


def test_the_plant_of_the_shipped_aircraft_is_found_by_name() -> None:
    assert find_device_driver(PLANT) is Plant


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("import no_such_bus\n", "ModuleNotFoundError: No module named 'no_such_bus'"),
        ("", "AttributeError"),
        ("1 / 0\n", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_driver_that_cannot_be_loaded_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: str, says: str
) -> None:
    name = f"driver_{len(code)}"
    install(tmp_path, monkeypatch, name, code, GROUP, **{name: f"{name}:Driver"})
    with pytest.raises(DeviceDriverError, match=rf"device driver '{name}' cannot be loaded \({says}"):
        find_device_driver(name)
    assert find_device_driver(PLANT) is Plant, "the others are not touched"


def test_a_pe_opens_the_drivers_of_what_its_modules_are_bolted_to() -> None:
    drivers = open_drivers(TABLE, 5, SIMULATED)
    assert drivers.keys() == {"left", "right"}
    assert drivers["left"] is drivers["right"], "one driver has both"
    assert isinstance(drivers["left"], Plant)


def test_a_pe_without_a_device_loads_no_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heronry_agent.shell.devices.entry_points", None)  # no driver is looked up
    assert open_drivers(GROUNDED, 5, choose_drivers(GROUNDED, {}, simulated=True)) == {}
    assert Devices(GROUNDED, {}).followed() == frozenset()


def test_a_driver_that_does_not_start_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_bus(_origin_ns: int) -> DeviceDriver:
        raise OSError(2, "No such file or directory", "/dev/i2c-1")

    monkeypatch.setattr("heronry_agent.shell.devices.find_device_driver", lambda _: no_bus)
    with pytest.raises(DeviceDriverError, match=r"device driver 'plant' does not start: FileNotFoundError.*/dev/i2c-1"):
        open_drivers(TABLE, 5, SIMULATED)


def test_a_device_that_its_driver_cannot_open_is_one_sentence() -> None:
    class Empty(RecordedDriver):
        def open(self, name: str) -> RecordedDevice:
            raise LookupError(f"nothing answers as {name}")

    with pytest.raises(DeviceDriverError, match="device left cannot be opened by its driver: LookupError: nothing"):
        Devices(TABLE, dict.fromkeys(("left", "right"), Empty()))


def test_a_driver_that_cannot_tell_what_it_follows_is_one_sentence() -> None:
    class Confused(RecordedDriver):
        def follows(self, sensors: Iterable[str]) -> frozenset[str]:
            raise KeyError(*sensors)

    devices = Devices(TABLE, dict.fromkeys(("left", "right"), Confused()))
    with pytest.raises(DeviceDriverError, match=r"the device driver of left, right failed in follows\(\): Key"):
        devices.followed()


def test_two_modules_on_one_device_have_the_same() -> None:
    both = tuple(replace(module, device="left" if module.device else None) for module in TABLE.modules)
    driver = RecordedDriver()
    devices = Devices(replace(TABLE, modules=both), {"left": driver})
    devices.drive(Drive(SERVO_1, 1.0), 0)
    devices.drive(Drive(SERVO_2, 2.0), 0)
    assert driver.opened == ["left"]
    assert driver.devices["left"].commands == [1.0, 2.0]


def test_each_of_two_drivers_has_its_own_devices_and_all_hear_an_echo() -> None:
    ours, theirs = RecordedDriver(), RecordedDriver()
    devices = Devices(TABLE, {"left": ours, "right": theirs})
    assert (ours.opened, theirs.opened) == (["left"], ["right"])
    assert devices.followed() == {"fin of left", "fin of right"}
    assert (ours.asked_to_follow, theirs.asked_to_follow) == (["left"], ["right"])
    devices.heard(Heard("rudder", 3.0), 0)
    assert ours.echoes == theirs.echoes == [("rudder", 3.0)]


# What a module is given, and what it drives


@pytest.mark.parametrize(
    ("reading", "given"),
    [
        (Reading(2.5, 0, valid=True), 2.5),
        (Reading(2.5, 0, valid=False), None),
        (Reading(None, 0, valid=True), None),
        (Reading(None, 0, valid=False), None),
    ],
)
def test_a_module_is_given_what_is_valid_and_nothing_else(reading: Reading, given: float | None) -> None:
    devices, _ = bolted(left=RecordedDevice(reading))
    assert devices.read(SERVO_1, 0) == given


def test_a_module_without_a_device_reads_nothing_drives_nothing_and_leaves_nothing_to_make_safe() -> None:
    devices, driver = bolted()
    assert devices.read(CONTROL, 0) is None
    assert devices.drive(Drive(CONTROL, 1.0), 0) == DriveFailed(CONTROL, "the module has no device to drive")
    devices.make_safe(CONTROL, 0)
    assert {device.made_safe for device in driver.devices.values()} == {0}


def test_what_a_driver_raises_is_silence_or_a_failed_command_and_ends_nothing() -> None:
    devices, driver = bolted(left=RecordedDevice(error=OSError(121, "Remote I/O error")))
    assert devices.read(SERVO_1, 0) is None
    assert devices.drive(Drive(SERVO_1, 1.0), 0) == DriveFailed(SERVO_1, "OSError: [Errno 121] Remote I/O error")
    driver.devices["left"].error = TypeError("left moves by a number, not by 'up'")
    assert devices.drive(Drive(SERVO_1, "up"), 0) == DriveFailed(SERVO_1, "left moves by a number, not by 'up'")
    devices.make_all_safe(0)
    assert [device.made_safe for device in driver.devices.values()] == [1, 1], "the other one all the same"


def test_an_echo_that_a_driver_chokes_on_ends_nothing() -> None:
    class Unreceptive(RecordedDriver):
        def heard(self, device: str, value: Value, now_ns: int) -> None:
            raise KeyError(device, value, now_ns)

    Devices(TABLE, dict.fromkeys(("left", "right"), Unreceptive())).heard(Heard("rudder", 3.0), 0)


# When a device is made safe


class Flown(OnePe):
    """A PE and its devices, driven and made safe as the core says."""

    def __init__(self) -> None:
        restarting = tuple(replace(module, restarts=1) for module in TABLE.modules)
        super().__init__(replace(TABLE, modules=restarting))
        self.devices, self.driver = bolted()
        self.configure(FLYING, 1)

    def made_safe(self) -> int:
        """Carry out the core's actions; gives how often the device of the first servo was made safe."""
        for at_ns, action in self.done:
            if isinstance(action, Drive):
                assert self.devices.drive(action, at_ns) == Driven(action.module, action.value)
            elif isinstance(action, StopModule) and not action.keep:
                self.devices.make_safe(action.module, at_ns)
        self.done.clear()
        return self.driver.devices["left"].made_safe


def test_a_device_is_not_made_safe_while_its_module_runs() -> None:
    pe = Flown()
    pe.fly(500 * MS, epoch=1, digest=1001)
    assert pe.made_safe() == 0
    assert pe.driver.devices["left"].commands


def test_a_device_is_made_safe_when_its_module_stops() -> None:
    pe = Flown()
    pe.configure(Slice((RUN_CONTROL,), remote=FLYING.remote), 2)
    assert SERVO_1 not in pe.running
    assert pe.made_safe() == 1


def test_a_device_is_made_safe_when_its_module_is_built_anew_and_when_it_is_given_up() -> None:
    pe = Flown()
    pe.give(DriveFailed(SERVO_1, "it jams"))
    assert pe.made_safe() == 1
    pe.pass_time(10 * MS)
    assert SERVO_1 in pe.running
    pe.give(DriveFailed(SERVO_1, "it jams"))
    assert SERVO_1 not in pe.running
    assert pe.made_safe() == 2


def test_a_device_is_made_safe_when_the_partition_of_its_module_ends() -> None:
    pe = Flown()
    pe.give(PartitionEnded("", "killed by signal 9", SERVO_1))
    assert pe.made_safe() == 1
