"""The devices of one PE as its modules meet them: read before a step, driven when the core allows it.

Both go through the agent's own process, whatever runs the module: so an output is checked at the last moment (protocol
rule 6), and a module that was stopped, or hangs, moves nothing. What is behind a device, its driver knows
(`heronry_agent.device`).
"""

from collections.abc import Callable
from importlib.metadata import entry_points

from heronry_agent.core.vocabulary import Drive, DriveFailed, Driven, Heard
from heronry_agent.device import Device, DeviceDriver
from heronry_agent.module import Value
from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import PeTable

_GROUP = "heronry.devices"
PLANT = "plant"  # the driver of the shipped aircraft's simulated devices


class UnknownDriverError(HeronryError, LookupError):
    """No such device driver; the message says which there are."""


def find_device_driver(name: str) -> Callable[[int], DeviceDriver]:
    """Give the driver of this name: a callable, see `heronry_agent.device`; raises UnknownDriverError."""
    offered = entry_points(group=_GROUP)
    if name not in offered.names:
        known = ", ".join(sorted(offered.names)) or "none"
        raise UnknownDriverError(f"no device driver is named '{name}'; installed here: {known}")
    try:
        found: Callable[[int], DeviceDriver] = offered[name].load()
    except (ImportError, AttributeError) as error:
        raise UnknownDriverError(f"device driver '{name}' cannot be loaded ({error}); is it installed here?") from error
    return found


class Devices:
    """What the modules of a table are bolted to."""

    def __init__(self, table: PeTable, driver: DeviceDriver) -> None:
        self._driver = driver
        self._bolted_to: dict[int, Device | None] = {
            module.index: None if module.device is None else driver.open(module.device) for module in table.modules
        }

    def read(self, module: int, now_ns: int) -> Value | None:
        """What a module's device says; None where it has none, or it does not answer, or says that it is wrong."""
        device = self._bolted_to[module]
        if device is None:
            return None
        value, _, valid = device.read(now_ns)
        return value if valid else None

    def drive(self, order: Drive, now_ns: int) -> Driven | DriveFailed | None:
        """Drive a module's device; None when it did not move."""
        device = self._bolted_to[order.module]
        if device is None:
            return DriveFailed(order.module, "it has no device to drive")
        try:
            moved_to = device.command(order.value, now_ns)
        except TypeError as error:
            return DriveFailed(order.module, str(error))
        return None if moved_to is None else Driven(order.module, moved_to)

    def make_safe(self, module: int, now_ns: int) -> None:
        """Take the safe action of a module's device: nobody drives it from now on."""
        device = self._bolted_to[module]
        if device is not None:
            device.make_safe(now_ns)

    def heard(self, echo: Heard, now_ns: int) -> None:
        """Follow what another PE has told one of its actuators."""
        self._driver.heard(echo.device, echo.value, now_ns)
