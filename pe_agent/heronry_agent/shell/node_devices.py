"""The devices of one node: which drivers it has, those of its first table, and those that another table adds in flight.

A driver is opened when the first table is read, or when a table comes beside it with devices that the first one lacks.
Simulated devices share one driver, so that they stand in one plant. A device whose driver, options or limits differ in
the new table cannot be changed in flight: its node must be restarted.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from heronry_agent.device import DeviceDriver
from heronry_agent.shell.device_choice import RealDriver, choose_drivers
from heronry_agent.shell.devices import PLANT, Buses, DeviceDriverError, Devices, open_drivers
from heronry_wire.pe_table import DriverEntry, ModuleEntry, PeTable


@dataclass
class NodeDevices:
    """Opens the devices of one node.

    named: drivers that the file of this node names. simulated: the driver of all other devices; None: the spec names
    them. buses: arguments of python-can, by name of the bus. Raises what `choose_drivers` and `open_drivers` raise.
    """

    table: PeTable
    named: Mapping[str, RealDriver]
    simulated: str | None
    origin_ns: int
    buses: Buses
    tell: Callable[[str], None]
    _entries: dict[str, DriverEntry] = field(init=False)

    def __post_init__(self) -> None:
        """Open the devices of the first table."""
        self._entries = _entries(self.table)
        self._chosen = self._choose(self.table)
        self._drivers = self._open(self.table, self._chosen)
        self.devices = Devices(self.table, self._drivers)

    def add(self, table: PeTable, added: Collection[ModuleEntry]) -> frozenset[int]:
        """Open the devices that another table adds, and return the numbers of all modules that come to rest slowly.

        added: the modules that are new to the host, with its numbers. Raises DeviceDriverError and DeviceChoiceError.
        """
        chosen, entries = self._choose(table), _entries(table)
        for device in chosen.keys() & self._chosen.keys():
            if chosen[device] != self._chosen[device] or entries.get(device) != self._entries.get(device):
                raise DeviceDriverError(f"the driver of device {device} is another one; restart this node for it")
        new = {device: driver for device, driver in chosen.items() if device not in self._chosen}
        plant = next((self._drivers[device] for device, driver in self._chosen.items() if driver is None), None)
        more = dict.fromkeys((d for d, driver in new.items() if driver is None), plant) if plant is not None else {}
        opened = {**more, **self._open(table, {d: driver for d, driver in new.items() if d not in more})}
        self.devices.add(table, added, opened)
        self._chosen |= new
        self._drivers |= opened
        self._entries |= entries
        return self.devices.slow_to_rest

    def _choose(self, table: PeTable) -> dict[str, RealDriver | None]:
        return choose_drivers(table, self.named, simulated=self.simulated is not None)

    def _open(self, table: PeTable, chosen: Mapping[str, RealDriver | None]) -> dict[str, DeviceDriver]:
        simulated = self.simulated or PLANT
        return open_drivers(table, self.origin_ns, chosen, simulated=simulated, buses=self.buses, tell=self.tell)


def _entries(table: PeTable) -> dict[str, DriverEntry]:
    return {entry.device: entry for entry in table.drivers}
