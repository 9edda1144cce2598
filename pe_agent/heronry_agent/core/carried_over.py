"""What goes on when another table takes the place of the one that flies, and which indices it has in the new one.

    module     goes on if its definition is the same: name, image, device with its driver, partition, and all modes with
               their rates, inputs and outputs. Where it may run, what it costs, and whether it is a branch of a DEMUX
               may differ. Every other module is stopped, and started anew if the new slice has it
    source     is the same if module, variable and type are the same; its identifier may differ
    element    (device, module, PE, bus, phase) and function are the same if they have the same name

A PE keeps its sockets and its heartbeat, so the buses of both tables must be the same, but for the nodes beyond a port.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from heronry_agent.core.table_index import TableIndex
from heronry_wire.management import PRIORITY_REQUEST_NUMBERS, ElementKind
from heronry_wire.pe_table import DriverEntry, ModuleEntry, PeTable, TableError

_Entry = TypeVar("_Entry")


def read_beside(text: bytes, flying: PeTable, number: int) -> PeTable:
    """Read a table that came while `flying` flies, with the partitions in which this node will run its modules.

    number: tells its partitions from those of other tables. Raises TableError if the PE cannot fly by it.
    """
    try:
        table = PeTable.from_json(text.decode())
    except UnicodeDecodeError:
        raise TableError("it is no text") from None
    TableIndex(table)
    if table.node_id != flying.node_id:
        raise TableError(f"it is for node {table.node_id}, not for this one")
    reason = _why_not(flying, table)
    if reason is not None:
        raise TableError(f"{reason}, so this PE must be restarted for it")
    return _in_own_partitions(flying, table, number)


def _why_not(old: PeTable, new: PeTable) -> str | None:
    """Say why a PE cannot fly by `new` after `old` without a restart; None: it can."""
    if old.uplink != new.uplink or len(old.ports) != len(new.ports):
        return "this PE has other buses in it"
    for before, after in zip(old.ports, new.ports, strict=True):
        if before != replace(after, nodes=before.nodes):
            return f"bus {before.bus} is another one in it"
    return None


class CarriedOver:
    """The indices, in a new table, of what goes on; all of `modules`, `sources`, `phases`, `functions` by old index."""

    def __init__(self, old: TableIndex, new: TableIndex) -> None:
        before, after = old.table, new.table
        self.modules = _same_modules(before, after)
        sources = {(source.module, source.variable): index for index, source in enumerate(after.sources)}
        named = ((index, sources.get((source.module, source.variable))) for index, source in enumerate(before.sources))
        self.sources = {
            index: found for index, found in named if found is not None and old.types[index] is new.types[found]
        }
        self.named_modules = _by_name(before.module_names, after.module_names)
        self.phases = _by_name((phase.name for phase in before.phases), (phase.name for phase in after.phases))
        self.functions = {
            index: after.adjustable[name] for name, index in before.adjustable.items() if name in after.adjustable
        }
        self._elements: Mapping[ElementKind, Mapping[int, int]] = {
            ElementKind.PE: _by_name(before.pe_names, after.pe_names),
            ElementKind.BUS: _by_name(before.bus_names, after.bus_names),
            ElementKind.MODULE: self.named_modules,
            ElementKind.DEVICE: _by_name((d.name for d in before.devices), (d.name for d in after.devices)),
            ElementKind.PHASE: self.phases,
        }

    def element(self, kind: ElementKind, index: int) -> int | None:
        """Return the index of an element, or the number of a priority request, in the new table; None: it has none."""
        if kind is ElementKind.PRIORITY:
            function = self.functions.get(index // PRIORITY_REQUEST_NUMBERS)
            number = index % PRIORITY_REQUEST_NUMBERS
            return None if function is None else function * PRIORITY_REQUEST_NUMBERS + number
        return self._elements[kind].get(index) if kind in self._elements else index

    def by_module(self, entries: Mapping[int, _Entry]) -> dict[int, _Entry]:
        """Return the entries of modules that go on, by their new indices."""
        return {self.modules[module]: entry for module, entry in entries.items() if module in self.modules}

    def by_source(self, entries: Mapping[int, _Entry]) -> dict[int, _Entry]:
        """Return the entries of sources that stay the same, by their new indices."""
        return {self.sources[source]: entry for source, entry in entries.items() if source in self.sources}


def _in_own_partitions(old: PeTable, new: PeTable, number: int) -> PeTable:
    """Return `new` with the partitions in which a node that flies by `old` runs its modules.

    A module that goes on stays in its process. All others run in processes of their own, which can load their code
    before the switch; `number` tells them from those of other tables.
    """
    here = {module.index: module.partition for module in old.modules}
    goes_on = {after: here[before] for before, after in _same_modules(old, new).items()}
    return new.with_partitions(
        {module.index: goes_on.get(module.index, f"{module.partition}+{number}") for module in new.modules}
    )


def _by_name(before: Iterable[str], after: Iterable[str]) -> dict[int, int]:
    index = {name: position for position, name in enumerate(after)}
    return {position: index[name] for position, name in enumerate(before) if name in index}


def _same_modules(before: PeTable, after: PeTable) -> dict[int, int]:
    same = {entry.name: entry for entry in after.modules}
    found = {}
    for entry in before.modules:
        other = same.get(entry.name)
        if other is not None and _definition(entry, before) == _definition(other, after):
            found[entry.index] = other.index
    return found


def _definition(entry: ModuleEntry, table: PeTable) -> tuple[object, ...]:
    """Return all that the running code of a module depends on."""
    driver: DriverEntry | None = next((one for one in table.drivers if one.device == entry.device), None)
    names = {leaf.variable for mode in entry.modes for leaf in mode.leaves}.union(*(mode.gives for mode in entry.modes))
    variables = {name: table.variables[name] for name in names}
    modes = [(mode.name, mode.rate_mhz, mode.leaves, mode.gives) for mode in entry.modes]
    partition = next(one.partition for one in table.compiled_form.modules if one.index == entry.index)
    return entry.name, entry.image, entry.device, driver, partition, modes, variables
