"""The inputs of the modules: the last datum of every source that this PE reads, and when a module gets it.

A mailbox belongs to one source and one *origin*, which is the PE that runs the module of the source. If a new slice
keeps the origin, the mailbox keeps its datum. If the origin changes, the mailbox is emptied, since a datum of the old
producer must not be used any more. A datum from another node, of another type, or without a version is refused.

A leaf gets a datum if the leaf accepts the version of the datum, and the datum is fresh: no older than three periods of
its source. (If the modes that give a source have different periods, the longest one counts.) Before the first datum a
leaf gets the variable's `initial` value, if there is one, in the best version that the leaf accepts; so feedback cycles
can start. Once a datum has come, the initial value is not used again: a datum that is too old counts as absent.

A value that stays on this PE passes through the same codec as a value on a bus, so a module gets the same number
wherever its producer runs: a FLOAT has single precision everywhere.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.table_index import TableIndex
from heronry_agent.module import Datum, Value
from heronry_wire.canaerospace import HEADER_BYTES, Status, Validity, decode_payload, read_header, unpack_status
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Malformed
from heronry_wire.protocol_times import FRESH_PERIODS

_STATUSES = tuple(unpack_status(code) for code in range(256))
_TRUSTED = (Validity.NOT_STATED, Validity.VALID, Validity.DEGRADED)


class Mailbox:
    """The last datum of one source, from the one PE that produces the source."""

    __slots__ = ("_data", "_length", "_status", "_time_ns", "_type_code", "_value", "max_age_ns", "node")

    def __init__(self, node: int, type_code: int, payload_bytes: int, max_age_ns: int) -> None:
        """Describe the data frames of a source.

        node: node-ID of the PE that produces the source.
        type_code: data type of CANaerospace.
        payload_bytes: length of the value in bytes.
        max_age_ns: time in ns for which a datum counts as fresh.
        """
        self.node = node
        self._type_code = type_code
        self._length = HEADER_BYTES + payload_bytes
        self.max_age_ns = max_age_ns
        self._time_ns: int | None = None
        self._data = b""
        self._status = Status(1, Validity.NOT_STATED)
        self._value: Value | None = None

    def put(self, data: bytes, now_ns: int) -> bool:
        """Store the datum in a data frame's bytes; `now_ns` is its time of arrival.

        Returns False, and stores nothing, if node, type, length or status byte is not that of this source.
        """
        if len(data) != self._length:
            return False
        node, type_code, service_code, _ = read_header(data)
        if node != self.node or type_code != self._type_code:
            return False
        status = _STATUSES[service_code]
        if isinstance(status, Malformed):
            return False
        self._time_ns, self._data, self._status, self._value = now_ns, data, status, None
        return True

    @property
    def time_ns(self) -> int | None:
        """When the last datum came, in ns; None since the mailbox was last emptied."""
        return self._time_ns

    def is_virgin(self) -> bool:
        """Tell whether no datum has come since the mailbox was last emptied."""
        return self._time_ns is None

    def read(self, best: int, worst: int, now_ns: int) -> Datum | None:
        """Return the datum if it is fresh and its version is in `best..worst`; otherwise None."""
        if self._time_ns is None or not best <= self._status.version <= worst:
            return None
        age_ns = now_ns - self._time_ns
        if age_ns > self.max_age_ns:
            return None
        if self._value is None:
            value = decode_payload(self._type_code, self._data[HEADER_BYTES:])
            self._value = 0 if value is None else value  # type NODATA has no value
        return Datum(self._value, self._status.version, age_ns, self._status.validity in _TRUSTED)


@dataclass(frozen=True, slots=True)
class _Wire:
    path: str
    variable: str
    best: int
    worst: int
    box: Mailbox
    initial: Value | None


class Mailboxes:
    """The mailboxes of all sources that this PE reads, and which mailbox supplies each leaf of its modules."""

    def __init__(self, index: TableIndex) -> None:
        self._index = index
        self.boxes: dict[int, Mailbox] = {}
        self._wires: dict[int, tuple[_Wire, ...]] = {}

    def carry_over(self, carried: CarriedOver) -> None:
        """Keep the datum of each source that another table has, too; the caller rewires the leaves afterwards."""
        self.boxes, self._wires = carried.by_source(self.boxes), {}

    def rewire(self, wanted: Slice) -> None:
        """Make the mailboxes that a new slice needs, and wire the leaves of its modules to them.

        If a source has a mailbox already and its producer stays on the same PE, it keeps mailbox and datum.
        """
        read = {source for module in wanted.modules for source in module.sources if source is not None}
        self.boxes = {source: self._box(source, wanted.remote.get(source, self._index.node)) for source in sorted(read)}
        self._wires = {
            module.module: tuple(self._wires_of(module.module, module.mode, module.sources))
            for module in wanted.modules
        }

    def inputs(self, module: int, now_ns: int) -> Mapping[str, tuple[str, Datum]]:
        """Return the present inputs of a module: (variable, datum) by path of the leaf.

        A leaf that has an initial value gets this value until the first datum of its source has come. A leaf
        that has neither a fresh datum nor this initial value is left out.
        """
        seen = {}
        for wire in self._wires[module]:
            datum = wire.box.read(wire.best, wire.worst, now_ns)
            if datum is None and wire.initial is not None and wire.box.is_virgin():
                datum = Datum(wire.initial, wire.best, 0)
            if datum is not None:
                seen[wire.path] = (wire.variable, datum)
        return seen

    def supply_all(self, module: int, named: Collection[str], now_ns: int) -> bool:
        """Tell whether a module has a usable datum of each variable in `named`."""
        usable = {variable for variable, datum in self.inputs(module, now_ns).values() if datum.valid}
        return usable.issuperset(named)

    def _box(self, source: int, node: int) -> Mailbox:
        held, data_type = self.boxes.get(source), self._index.types[source]
        max_age_ns = FRESH_PERIODS * self._index.table.sources[source].period_ns
        if held is not None and held.node == node:
            held.max_age_ns = max_age_ns
            return held
        return Mailbox(node, data_type, data_type.payload_bytes, max_age_ns)

    def _wires_of(self, module: int, mode: int, sources: tuple[int | None, ...]) -> list[_Wire]:
        wires = []
        for leaf, source in zip(self._index.modules[module].modes[mode].leaves, sources, strict=True):
            if source is not None:
                initial = self._index.table.variables[leaf.variable].initial
                wires.append(_Wire(leaf.path, leaf.variable, leaf.best, leaf.worst, self.boxes[source], initial))
        return wires
