"""The devices of one PE: each is read before every step of its module, and executes commands that the core authorizes.

The agent's process reads and commands the devices; the partition of a module does not. So the authorization is checked
at the last moment (protocol rule 6), and a module that was stopped, or hangs, moves nothing. Only the device drivers
(`heronry_agent.device`) depend on the hardware.

Each device has one driver. At present all devices of a PE have the same driver, since a spec cannot name a driver yet:
the driver that `pe-agent --devices` names, by default the plant. Only `open_drivers` depends on this; all other code
here allows several drivers on a PE.

A driver is foreign code in the agent's process. Its exceptions do not end a running agent: after an exception a reading
counts as missing, and a command as failed (`DriveFailed`). A driver that blocks also blocks the agent's loop; this file
cannot prevent that.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import entry_points

from heronry_agent.core.vocabulary import Drive, DriveFailed, Driven, Heard
from heronry_agent.device import Device, DeviceDriver
from heronry_agent.module import Value
from heronry_agent.shell.module_runner import one_line
from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import PeTable

_GROUP = "heronry.devices"
PLANT = "plant"  # name of the driver of the shipped aircraft's simulated devices


class DeviceDriverError(HeronryError):
    """A device driver is not installed, or has failed; the message is one sentence."""


def find_device_driver(name: str) -> Callable[[int], DeviceDriver]:
    """Find an installed driver by its name; raises DeviceDriverError.

    Returns a callable that takes the take-off time of the simulated flight in ns, and returns the DeviceDriver.
    """
    offered = entry_points(group=_GROUP)
    if name not in offered.names:
        known = ", ".join(sorted(offered.names)) or "none"
        raise DeviceDriverError(f"no device driver is named '{name}'; installed are: {known}")
    try:
        found: Callable[[int], DeviceDriver] = offered[name].load()
    except Exception as error:
        raise DeviceDriverError(
            f"device driver '{name}' cannot be loaded ({one_line(error)}); install its package again, with all it needs"
        ) from error
    return found


def open_drivers(table: PeTable, origin_ns: int, name: str = PLANT) -> dict[str, DeviceDriver]:
    """Start the device driver `name`; returns, by name of a device, the driver that opens it.

    The mapping has an entry for each device of the modules in the table, with the same driver for all.
    It is empty, and no driver is started, if no module of the table has a device.

    origin_ns: take-off time of the simulated flight, in ns of the monotonic clock.

    Raises DeviceDriverError.
    """
    names = {module.device: name for module in table.modules if module.device is not None}
    made = {name: _started(name, origin_ns) for name in sorted(set(names.values()))}
    return {device: made[name] for device, name in names.items()}


def _started(name: str, origin_ns: int) -> DeviceDriver:
    driver = find_device_driver(name)
    try:
        return driver(origin_ns)
    except Exception as error:
        raise DeviceDriverError(
            f"device driver '{name}' does not start: {one_line(error)}; "
            "mend what it needs on this computer, or name another driver with --devices"
        ) from error


class Devices:
    """The opened devices of the modules in a table."""

    def __init__(self, table: PeTable, drivers: Mapping[str, DeviceDriver]) -> None:
        """Open the devices of all modules of a table; raises DeviceDriverError.

        drivers: the driver of each device, by name of the device.
        """
        self._drivers = drivers
        self._every_driver = tuple({id(driver): driver for driver in drivers.values()}.values())
        self._opened: dict[str, Device] = {}
        self._bolted_to = {module.index: self._open(module.device) for module in table.modules}

    def _open(self, name: str | None) -> Device | None:
        if name is None:
            return None
        if name not in self._opened:
            try:
                self._opened[name] = self._drivers[name].open(name)
            except Exception as error:
                raise DeviceDriverError(
                    f"device {name} cannot be opened by its driver: {one_line(error)}; "
                    "check the device and its connection, or name another driver with --devices"
                ) from error
        return self._opened[name]

    def followed(self) -> frozenset[str]:
        """Return the names of other PEs' actuators whose output echoes the drivers need; raises DeviceDriverError."""
        followed: frozenset[str] = frozenset()
        for driver in self._every_driver:
            names = [name for name, its_driver in self._drivers.items() if its_driver is driver]
            try:
                followed |= driver.follows(names)
            except Exception as error:
                raise DeviceDriverError(
                    f"the device driver of {', '.join(names)} failed in follows(): {one_line(error)}; "
                    "correct this method in the driver's code"
                ) from error
        return followed

    def every_echo(self) -> bool:
        """Tell whether a driver simulates devices, so that plants of other PEs need an echo of every command."""
        return any(getattr(driver, "every_echo", False) for driver in self._every_driver)

    def read(self, module: int, now_ns: int) -> Value | None:
        """Read the device of a module; None if the module has no device, or there is no valid reading."""
        device = self._bolted_to[module]
        if device is None:
            return None
        try:
            value, _, valid = device.read(now_ns)
        except Exception:  # noqa: BLE001 - foreign code: after any exception there is no reading
            return None
        return value if valid else None

    def drive(self, order: Drive, now_ns: int) -> Driven | DriveFailed | None:
        """Command the device of a module.

        Returns Driven with the value to which the device moved, or DriveFailed with the reason if the command
        failed; None if the command succeeded, but the device did not move.
        """
        device = self._bolted_to[order.module]
        if device is None:
            return DriveFailed(order.module, "the module has no device to drive")
        try:
            moved_to = device.command(order.value, now_ns)
        except TypeError as error:
            return DriveFailed(order.module, str(error))
        except Exception as error:  # noqa: BLE001 - foreign code may raise anything
            return DriveFailed(order.module, one_line(error))
        return None if moved_to is None else Driven(order.module, moved_to)

    def make_safe(self, module: int, now_ns: int) -> None:
        """Take the safe action of a module's device, because the module no longer drives it."""
        device = self._bolted_to[module]
        if device is not None:
            _make_safe(device, now_ns)

    def make_all_safe(self, now_ns: int) -> None:
        """Take the safe action of every device, because no module runs any more."""
        for device in self._opened.values():
            _make_safe(device, now_ns)

    def heard(self, echo: Heard, now_ns: int) -> None:
        """Hand the value in another PE's output echo to every device driver; an exception in a driver has no effect."""
        for driver in self._every_driver:
            with suppress(Exception):  # foreign code; the next echo repeats the value
                driver.heard(echo.device, echo.value, now_ns)


def _make_safe(device: Device, now_ns: int) -> None:
    """Take the safe action of a device; an exception of its driver is ignored, since nothing else can be done."""
    with suppress(Exception):
        device.make_safe(now_ns)
