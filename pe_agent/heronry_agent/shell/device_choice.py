"""Which driver each device of a PE has: from the table, from a file of this node, or the simulated plant.

    --devices FILE      a JSON object, by name of a device: {"gps": {"driver": "nmea", "options": {"port": "..."}}}. It
                        counts before the table. Devices of other PEs in it are skipped, so one file serves a fleet
    --simulated [NAME]  every device that FILE does not name is simulated, by the plant or by the driver NAME
    neither             every device has the driver that the table names; one without a driver is an error

So a real node never flies a simulated device by accident.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from heronry_wire.errors import HeronryError
from heronry_wire.ordinary_file import read_ordinary
from heronry_wire.pe_table import DriverEntry, PeTable
from heronry_wire.spelling import meant

_MOST_BYTES = 1024 * 1024
_FORM = 'write {"DEVICE": {"driver": "NAME", "options": {}}}'


class DeviceChoiceError(HeronryError):
    """A device has no driver, or the file of devices cannot be used; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class RealDriver:
    """The driver of a device, with its options as given."""

    driver: str
    options: Mapping[str, Any] = field(default_factory=dict)


def read_devices(file: Path) -> dict[str, RealDriver]:
    """Read a file of devices; raises DeviceChoiceError."""
    try:
        content = json.loads(read_ordinary(file, _MOST_BYTES))
    except OSError as error:
        raise DeviceChoiceError(f"{file}: {error.strerror}; name a file with the drivers of devices") from None
    except (ValueError, RecursionError) as error:
        raise DeviceChoiceError(f"{file}: this is not JSON ({error}); {_FORM}") from None
    if not isinstance(content, dict):
        raise DeviceChoiceError(f"{file}: this is not a JSON object; {_FORM}")
    return {name: _read_one(file, name, one) for name, one in content.items()}


def _read_one(file: Path, name: str, one: object) -> RealDriver:
    match one:
        case {"driver": str(driver), **rest} if rest.keys() <= {"options"}:
            options = rest.get("options", {})
            if isinstance(options, dict):
                return RealDriver(driver, options)
        case _:
            pass
    raise DeviceChoiceError(f"{file}: the entry of device '{name:.70}' cannot be read; {_FORM}")


def choose_drivers(table: PeTable, named: Mapping[str, RealDriver], *, simulated: bool) -> dict[str, RealDriver | None]:
    """Return the driver of each device that a module of the table names; None: it is simulated.

    named: what the file of this node says. Raises DeviceChoiceError and UnknownDriverError.
    """
    known = {device.name for device in table.devices}
    for name in named:
        if name not in known:
            raise DeviceChoiceError(f"the spec has no device '{name:.70}'; {meant(name, known)}")
    entries = {entry.device: entry for entry in table.drivers}
    devices = sorted({module.device for module in table.modules if module.device is not None})
    return {device: _choose(device, named.get(device), entries.get(device), simulated) for device in devices}


def _choose(device: str, named: RealDriver | None, entry: DriverEntry | None, simulated: bool) -> RealDriver | None:
    found = named
    if found is None and simulated:
        return None
    if found is None and entry is not None and entry.driver is not None:
        found = RealDriver(entry.driver, json.loads(entry.options))
    if found is None:
        raise DeviceChoiceError(
            f"device {device} has no driver: name one in the spec or in --devices FILE, or fly simulated devices with "
            "--simulated"
        )
    from heronry_agent.shell.driver_catalogue import UnknownDriverError, target_of  # noqa: PLC0415 - most PEs need none

    try:
        target_of(found.driver)
    except UnknownDriverError as error:
        raise DeviceChoiceError(f"device {device}: {error}") from None
    return found
