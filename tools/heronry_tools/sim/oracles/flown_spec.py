"""A spec by which PEs fly, and what of it goes on when another spec takes its place."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from heronry_dg.model import Spec
from heronry_dg.situation import elements, places
from heronry_wire.pe_table import DriverEntry, ModuleEntry, PeTable


def all_elements(spec: Spec) -> frozenset[str]:
    """Return every element of a spec, and every place of its modules (`module:NAME@PE`)."""
    return frozenset((*elements(spec), *(place for module in spec.modules for place in places(spec, module))))


@dataclass(frozen=True)
class FlownSpec:
    """A spec, and the table of each of its PEs, by the name of the PE."""

    spec: Spec
    tables: Mapping[str, PeTable]

    @cached_property
    def texts(self) -> Mapping[str, str]:
        """The tables as text, by the name of the PE."""
        return {pe: table.to_json() for pe, table in self.tables.items()}

    @property
    def exclusive(self) -> frozenset[str]:
        """The modules that a PE does not step while it is not authorized: the branches of a DEMUX, and its ends."""
        entries = (entry for table in self.tables.values() for entry in table.modules)
        return frozenset(entry.name for entry in entries if entry.demux)

    def goes_on(self, other: "FlownSpec", pe: str) -> frozenset[str]:
        """Return the modules that go on, on this PE, when `other` takes the place of this spec, or the reverse.

        Of such a module these are equal: image, device with its driver, partition, modes, rates, inputs and outputs.
        """
        mine, others = self._definitions(pe), other._definitions(pe)
        return frozenset(name for name, definition in mine.items() if others.get(name) == definition)

    def _definitions(self, pe: str) -> dict[str, tuple[object, ...]]:
        table = self.tables.get(pe)
        if table is None:
            return {}
        drivers = {driver.device: driver for driver in table.drivers}
        return {entry.name: self._definition(entry, drivers) for entry in table.modules}

    def _definition(self, entry: ModuleEntry, drivers: Mapping[str, DriverEntry]) -> tuple[object, ...]:
        modes = []
        for mode in self.spec.modules[entry.name].modes.values():
            read = [
                (path, leaf.variable, leaf.best, leaf.worst, self._kind(leaf.variable)) for path, leaf in mode.leaves()
            ]
            given = [(variable, version, self._kind(variable)) for variable, version in mode.gives.items()]
            modes.append((mode.name, mode.rate_mhz, read, given))
        driver = None if entry.device is None else drivers.get(entry.device)
        return entry.image, entry.device, driver, entry.partition, modes

    def _kind(self, variable: str) -> tuple[object, ...]:
        return self.spec.variables[variable].type, self.spec.variables[variable].initial
