"""What an agent tells the process of a device when it starts the process: one line of JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class DeviceOrders:
    """All that the process of one device is told."""

    device: str
    is_actuator: bool
    driver: str  # as the spec or the file of devices names it
    options: Mapping[str, Any]  # as given; the process checks them against the driver
    period_ns: int  # shortest period of the modules on the device
    safe: str | float = "release"  # of an actuator: "hold", "release", or a value
    least: float | None = None  # of an actuator: a command below is raised to it
    most: float | None = None  # of an actuator: a command above is lowered to it
    per_s: float | None = None  # of an actuator: fastest change in units per second
    buses: Mapping[str, Mapping[str, Any]] | None = None  # arguments of python-can, by name of the bus
    uplink: str = ""

    def to_json(self) -> str:
        """Return the orders as text in one line."""
        return json.dumps(asdict(self), default=str)

    @staticmethod
    def from_json(text: str) -> "DeviceOrders":
        """Read what `to_json` gives."""
        return DeviceOrders(**json.loads(text))
