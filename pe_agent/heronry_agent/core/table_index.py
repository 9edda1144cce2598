"""Quick look-ups in a PE's table.

The constructor checks the table, and raises TableError if the table contradicts itself. So no contradiction stops the
agent later: after the check, every look-up of a name or index of the table succeeds.
"""

from collections.abc import Iterable

from heronry_wire.canaerospace import DataType
from heronry_wire.configuration_slice import SliceError, decode_slice
from heronry_wire.identifiers import PE_NODES
from heronry_wire.management import ElementKind
from heronry_wire.pe_table import ModuleEntry, PeTable, Port, TableError
from heronry_wire.protocol_times import t_lease_ns
from heronry_wire.timing import WORST_BLOCKING_BITS

_REMEDY = "write the table anew with 'heronry table'"
_CONTENTS = (
    *("table", "node", "ports", "uplink", "lease_ns", "leased_ns", "stand_back_ns", "modules", "leaf_counts"),
    *("source_of", "_movable", "_contested", "movable", "contested", "types", "elements", "critical", "phase_index"),
    *("actuators", "device_index", "_preloaded"),
)


class TableIndex:
    """Finds entries of a table by the indices and names that slices, modules and frames use."""

    def __init__(self, table: PeTable) -> None:
        """Index a table; raises TableError if the table contradicts itself."""
        self.table = table
        self.node = table.node_id
        self.ports = range(len(table.ports))
        self.uplink = table.uplink
        self.lease_ns = t_lease_ns(table.ports[table.uplink].heartbeat_ns)
        self.leased_ns = max(self.lease_ns, t_lease_ns(table.command_period_ns))  # how long one LEASE is valid
        self.stand_back_ns = _stand_back_ns(table.ports[table.uplink])
        self.modules: dict[int, ModuleEntry] = {module.index: module for module in table.modules}
        self.leaf_counts = table.leaf_counts()
        self.source_of = {(s.module, s.variable): index for index, s in enumerate(table.sources)}
        movable = {module.name for module in table.modules if module.movable}
        self._movable = frozenset(i for i, source in enumerate(table.sources) if source.module in movable)
        self._contested = frozenset(i for i, source in enumerate(table.sources) if source.movable)
        self.movable, self.contested = self._movable, self._contested  # with those that `share` adds
        self.types = tuple(_data_type(table, source.variable) for source in table.sources)
        self.elements = _elements(table)
        self.critical = frozenset(self.elements[name] for name in table.flight_critical if name in self.elements)
        self.phase_index = {phase.name: index for index, phase in enumerate(table.phases)}
        self.actuators = frozenset(device.name for device in table.devices if device.kind == "actuator")
        self.device_index = {device.name: index for index, device in enumerate(table.devices)}
        self._preloaded = table.preloaded()
        _check(table, self.source_of)
        self._check_preloaded()

    def share(self, other: "TableIndex | None") -> None:
        """Count as exclusive, too, each source whose identifier another module has in `other`, the table beside.

        Another PE may send under such an identifier as soon as it flies by that table (protocol rule 6).
        """
        holders = {} if other is None else {s.identifier: (s.module, s.variable) for s in other.table.sources}
        passing = frozenset(
            index
            for index, source in enumerate(self.table.sources)
            if holders.get(source.identifier, (source.module, source.variable)) != (source.module, source.variable)
        )
        self.movable, self.contested = self._movable | passing, self._contested | passing

    def exchange(self, other: "TableIndex") -> None:
        """Exchange the contents with `other`: every part of the agent holds this object, whichever table flies."""
        for name in _CONTENTS:
            mine, its = getattr(self, name), getattr(other, name)
            setattr(self, name, its)
            setattr(other, name, mine)

    def on_board(self, number: int, digest: int) -> bytes | None:
        """Return the slice of contingency `number` as bytes.

        Returns None if the contingency is not on board, or if its configuration has another digest than `digest`.
        """
        if not 0 < number <= len(self._preloaded):
            return None
        found = self._preloaded[number - 1]
        return found.slice if found.digest == digest else None

    def _check_preloaded(self) -> None:
        for body in {one.slice for one in self._preloaded}:
            try:
                decode_slice(body, self.leaf_counts)
            except SliceError as error:
                raise TableError(f"the slice of a contingency in the table is damaged ({error}); {_REMEDY}") from None

    def leaf_variables(self, module: int, mode: int) -> tuple[str, ...]:
        """Return the variable of each leaf of a mode, in the order that slices use."""
        return tuple(leaf.variable for leaf in self.modules[module].modes[mode].leaves)

    def identifiers(self, sources: Iterable[int]) -> frozenset[int]:
        """Return the CAN identifiers of sources, which are given by their indices."""
        return frozenset(self.table.sources[source].identifier for source in sources)

    def gives(self, module: int, mode: int) -> dict[int, int]:
        """Return the version of each source that a module gives in a mode, by index of the source."""
        entry = self.modules[module]
        return {self.source_of[entry.name, variable]: v for variable, v in entry.modes[mode].gives.items()}


def _stand_back_ns(port: Port) -> int:
    """Time in ns for which data stand back after a PREPARE: that of four commands and three frames of each PE."""
    frames = 4 + 3 * (1 + len(port.nodes))
    return frames * WORST_BLOCKING_BITS * 1_000_000_000 // port.bitrate


def _data_type(table: PeTable, variable: str) -> DataType:
    entry = table.variables.get(variable)
    if entry is None or entry.type not in DataType.__members__:
        raise TableError(f"in the table, variable {variable} has no CANaerospace type; {_REMEDY}")
    return DataType[entry.type]


def _elements(table: PeTable) -> dict[str, tuple[ElementKind, int]]:
    devices = {f"device:{d.name}": (ElementKind.DEVICE, i) for i, d in enumerate(table.devices)}
    modules = {f"module:{name}": (ElementKind.MODULE, i) for i, name in enumerate(table.module_names)}
    pes = {f"pe:{name}": (ElementKind.PE, i) for i, name in enumerate(table.pe_names)}
    buses = {f"bus:{name}": (ElementKind.BUS, i) for i, name in enumerate(table.bus_names)}
    return devices | modules | pes | buses


def _check_sources(table: PeTable) -> None:
    holders: dict[int, str] = {}
    for source in table.sources:
        name = f"{source.variable} of module {source.module}"
        if source.identifier in holders:
            raise TableError(f"in the table, {holders[source.identifier]} and {name} share an identifier; {_REMEDY}")
        if source.period_ns <= 0:
            raise TableError(f"in the table, the period of {name} is not above 0; {_REMEDY}")
        holders[source.identifier] = name


def _check(table: PeTable, source_of: dict[tuple[str, str], int]) -> None:
    _check_sources(table)
    for port in table.ports:
        if port.heartbeat_ns <= 0:
            raise TableError(f"in the table, the heartbeat period of bus {port.bus} is not above 0; {_REMEDY}")
    odd = [device for device in table.devices if device.node not in PE_NODES]
    if odd:
        raise TableError(f"the table puts device {odd[0].name} on node {odd[0].node}, which is not a PE; {_REMEDY}")
    for module in table.modules:
        for mode in module.modes:
            for variable, version in mode.gives.items():
                if (module.name, variable) not in source_of:
                    raise TableError(
                        f"module {module.name} gives {variable}, but the table has no source for it; {_REMEDY}"
                    )
                if not 1 <= version <= 15:
                    raise TableError(
                        f"in the table, module {module.name} gives version {version} of {variable}, not 1 to 15; "
                        f"{_REMEDY}"
                    )
