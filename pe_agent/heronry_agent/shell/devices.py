"""The devices of one PE: each is read before every step of its module, and executes commands that the core authorizes.

The agent's process reads and commands the devices; the partition of a module does not. So the authorization is checked
at the last moment (protocol rule 6), and a module that was stopped, or hangs, moves nothing. Only the device drivers
(`heronry_agent.device`) depend on the hardware.

Each device has one driver (`device_choice`). A simulated device is opened by an installed driver of the group
`heronry.devices`, which runs in the agent's process: it is foreign code, but its exceptions do not end a running agent.
After an exception a reading counts as missing, and a command as failed (`DriveFailed`). If it blocks, the agent's loop
waits. A real device has a process of its own (`device_processes`), so that neither its code nor its hardware disturbs
the agent. A simulated sensor of which the spec says something is late as a real one would be (`simulated_sensor`).

If a device has failed, the report goes out with the answer to the next step of its module, as if the module had
reported it.
"""

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, Protocol, runtime_checkable

from heronry_agent.core.vocabulary import Drive, DriveFailed, Driven, Heard
from heronry_agent.device import Device, DeviceDriver
from heronry_agent.module import Value
from heronry_agent.shell.device_choice import RealDriver
from heronry_agent.shell.module_runner import one_line
from heronry_agent.shell.partition_log import PartitionLog
from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import ModuleEntry, PeTable

Buses = Mapping[str, Mapping[str, Any]]

_GROUP = "heronry.devices"
PLANT = "plant"  # name of the driver of the shipped aircraft's simulated devices


@runtime_checkable
class RealDevice(Device, Protocol):
    """A device with a process of its own (`device_processes.isolated`)."""

    @property
    def pid(self) -> int | None:
        """Number of the process; None while there is none."""

    @property
    def log(self) -> PartitionLog | None:
        """The pipe to which the process prints; None if there is none."""

    def renew(self, exclusive_until_ns: int, lease_ns: int, now_ns: int) -> None:
        """Renew the validity of the present command."""

    def look(self, now_ns: int) -> None:
        """Look after the process."""

    def next_deadline_ns(self) -> int:
        """Time in ns at which to call `look`, if nothing else comes before."""

    def is_failed(self, now_ns: int) -> bool:
        """Tell whether the device is to be reported failed."""

    @property
    def owes(self) -> bool:
        """Tell whether an actuator has commands that its process has not dealt with."""

    def let_end(self) -> None:
        """Let the process end, and do not wait."""

    def close(self) -> None:
        """End the process."""


@runtime_checkable
class Watched(Device, Protocol):
    """A device that knows when it has failed: a real one, or a simulated sensor with a deadline."""

    def is_failed(self, now_ns: int) -> bool:
        """Tell whether the device is to be reported failed."""


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


def open_drivers(
    table: PeTable,
    origin_ns: int,
    chosen: Mapping[str, RealDriver | None],
    *,
    simulated: str = PLANT,
    buses: Buses = MappingProxyType({}),
    tell: Callable[[str], None] = lambda _: None,
) -> dict[str, DeviceDriver]:
    """Start the drivers of a PE's devices; returns, by name of a device, the driver that opens it.

    origin_ns: take-off time of the simulated flight, in ns of the monotonic clock.
    chosen: the driver of each device; None: it is simulated, by the driver `simulated`, which is started only then.
    buses: arguments of python-can, by name of the bus.
    tell: called with a sentence for the log.

    Raises DeviceDriverError.
    """
    real = {device: driver for device, driver in chosen.items() if driver is not None}
    drivers: dict[str, DeviceDriver] = {}
    if real:
        from heronry_agent.shell.device_processes.isolated import IsolatedDriver  # noqa: PLC0415 - most PEs need none

        drivers = dict.fromkeys(real, IsolatedDriver(table, real, buses, tell))
    if len(real) < len(chosen):
        drivers |= dict.fromkeys(chosen.keys() - real.keys(), _started(simulated, origin_ns))
    return drivers


def _started(name: str, origin_ns: int) -> DeviceDriver:
    driver = find_device_driver(name)
    try:
        return driver(origin_ns)
    except Exception as error:
        raise DeviceDriverError(
            f"device driver '{name}' does not start: {one_line(error)}; "
            "mend what it needs on this computer, or name another driver with --simulated"
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
        sensors = {device.name for device in table.devices if device.kind == "sensor"}
        self._stale_ns = {entry.device: entry.stale_ns for entry in table.drivers if entry.device in sensors}
        self._names = {module.index: module.device for module in table.modules}
        self._bolted_to: dict[int, Device | None] = {}
        self.slow_to_rest: frozenset[int] = frozenset()
        self._moving: dict[int, int] = {}  # those of them that were stopped and still move, and until when to wait
        self._lease_ns = 0
        self._bolt(table.modules)

    def add(self, table: PeTable, modules: Collection[ModuleEntry], more: Mapping[str, DeviceDriver]) -> None:
        """Open the devices of more modules, which another table adds; raises DeviceDriverError.

        table: the one that adds them. modules: with the numbers by which the host knows them. more: drivers of their
        devices, by name; a device that is open keeps the driver that it has.
        """
        self._drivers = {**more, **self._drivers}
        self._every_driver = tuple({id(driver): driver for driver in self._drivers.values()}.values())
        sensors = {device.name for device in table.devices if device.kind == "sensor"}
        self._stale_ns |= {entry.device: entry.stale_ns for entry in table.drivers if entry.device in sensors}
        self._names |= {module.index: module.device for module in modules}
        self._bolt(modules)

    def _bolt(self, modules: Collection[ModuleEntry]) -> None:
        """Open the devices of modules, and note which module has which."""
        opened = {module.index: self._open(module.device) for module in modules}
        self._bolted_to |= opened
        self.real = tuple(device for device in self._opened.values() if isinstance(device, RealDevice))
        self.slow_to_rest |= {module.index for module in modules if module.demux and opened[module.index] in self.real}
        self._watched = {module: device for module, device in self._bolted_to.items() if isinstance(device, Watched)}

    def _open(self, name: str | None) -> Device | None:
        if name is None:
            return None
        if name not in self._opened:
            try:
                self._opened[name] = self._judged(name, self._drivers[name].open(name))
            except Exception as error:
                raise DeviceDriverError(
                    f"device {name} cannot be opened by its driver: {one_line(error)}; "
                    "check the device and its connection, or name another driver"
                ) from error
        return self._opened[name]

    def _judged(self, name: str, device: Device) -> Device:
        if isinstance(device, Watched) or name not in self._stale_ns:
            return device
        from heronry_agent.shell.simulated_sensor import SimulatedSensor  # noqa: PLC0415 - few specs need it

        return SimulatedSensor(device, self._stale_ns[name])

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
        if module in self.slow_to_rest:
            self._moving[module] = now_ns + self._lease_ns

    def begun(self, module: int) -> None:
        """Note that a module starts: its device is driven again."""
        self._moving.pop(module, None)

    @property
    def are_moving(self) -> bool:
        """Tell whether the device of a stopped branch of a DEMUX has not come to rest."""
        return bool(self._moving)

    def at_rest(self, now_ns: int) -> list[int]:
        """Return the modules whose devices have taken the safe action since the last call.

        A device that has not done so within T_lease is forgotten, as the core does not wait longer (`rests`).
        """
        found = [m for m in self._moving if isinstance(device := self._bolted_to[m], RealDevice) and not device.owes]
        self._moving = {m: until_ns for m, until_ns in self._moving.items() if m not in found and now_ns < until_ns}
        return found

    def make_all_safe(self, now_ns: int) -> None:
        """Take the safe action of every device, because no module runs any more."""
        for device in self._opened.values():
            _make_safe(device, now_ns)

    def reports(self, module: int, now_ns: int) -> tuple[tuple[str, int], ...]:
        """Return the report that the device of a module has failed, as a module would give it, or none."""
        device = self._watched.get(module)
        if device is not None and device.is_failed(now_ns):
            return ((f"device:{self._names[module]}", 0),)
        return ()

    def look(self, exclusive_until_ns: int, lease_ns: int, now_ns: int) -> None:
        """Renew the validity of commands to real devices, and look after their processes; call it in every turn.

        exclusive_until_ns: end of the authorization of exclusive outputs, before `now_ns` if there is none.
        """
        self._lease_ns = lease_ns
        for device in self.real:
            device.renew(exclusive_until_ns, lease_ns, now_ns)
            device.look(now_ns)

    def close(self) -> None:
        """End the processes of real devices, after their safe actions, which they all take at the same time."""
        for device in self.real:
            device.let_end()
        for device in self.real:
            device.close()

    def heard(self, echo: Heard, now_ns: int) -> None:
        """Hand the value in another PE's output echo to every device driver; an exception in a driver has no effect."""
        for driver in self._every_driver:
            with suppress(Exception):  # foreign code; the next echo repeats the value
                driver.heard(echo.device, echo.value, now_ns)


def _make_safe(device: Device, now_ns: int) -> None:
    """Take the safe action of a device; an exception of its driver is ignored, since nothing else can be done."""
    with suppress(Exception):
        device.make_safe(now_ns)
