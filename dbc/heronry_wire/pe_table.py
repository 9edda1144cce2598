"""The table of one PE: all that the PE needs of a spec. The manager compiles it, and the agent reads it.

The agent reads neither a graph nor YAML. The table tells what the indices in a slice mean: modules with their modes and
leaves, and sources with their identifiers. The table also says which nodes are reached through which bus.

A table is JSON text (UTF-8), one object. `PeTable.to_json` writes the text. `PeTable.from_json` reads it, and raises
TableError if any part of the text is wrong. The last key, `sha256`, is a check sum of all other keys and values: of a
table with a flipped bit nothing is believed.

The *identity* of a table (`PeTable.identity`) is a digest of what the PE and the manager must have in common: all
fields, with the major of the protocol, except

- the contingencies, whose digests cover the identity,
- periods of heartbeats, since a demo on a slow computer flies with longer ones than its spec has, and the rate of
  echoes, which follows from them, and
- what minors of the protocol added.

Digests of slices cover the identity (`configuration_slice`). So a PE whose wiring differs from what its manager
compiled, for whatever reason, stages nothing.

*Growth.* A field that a minor of the protocol adds is declared with `added_in`, and has a default. A table of an older
minor lacks the field, and the default stands in; an agent of an older minor skips the field.

The index of a module, device or bus is its position in the whole spec, in the spec's order. A *source* is a pair
(producing module, variable), counted in the order of `Spec.sources`. A *port* is one of this PE's buses, in the order
of its `buses`.
"""

import hashlib
import json
import math
import re
import reprlib
from base64 import b64decode
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from itertools import chain
from types import UnionType
from typing import Any, Literal, Self, Union, get_args, get_origin

from heronry_wire.checkpoint_frames import MOST_CHECKPOINTS, MOST_STATE_BYTES
from heronry_wire.contingency_block import Preloaded, read_block
from heronry_wire.errors import HeronryError, on_one_line
from heronry_wire.identifiers import GATEWAY_IDS, PE_NODES, Use, classify
from heronry_wire.packing import PackingError
from heronry_wire.protocol_version import OUTSIDE_IDENTITY, PROTOCOL, Version

STALE_PERIODS = 5
"""A reading of a sensor is not valid if it is older than so many periods of the fastest module on the sensor."""

_REMEDY = "write the table anew with 'heronry table'"
_COMPILE = "compile the spec first, on a computer with the manager: heronry table SPEC PE -o PE.table"
_SPEC = re.compile(r"^dg *:", re.MULTILINE)  # the key with which every spec begins
_SHA_256 = re.compile("[0-9a-f]{64}")
_CHECK_SUM = "sha256"  # the key of the check sum
_COMPACT = (",", ":")


def added_in(minor: int, default: Any, *, told_if_any: bool = False) -> Any:
    """Declare a field of a table that this minor of the protocol added.

    default: what a table of an older minor means; a PE of an older minor behaves so, whatever the field says.
    told_if_any: whether the text of a table leaves the field out if it has its default.
    """
    return field(default=default, metadata={"since": minor, "told_if_any": told_if_any, **OUTSIDE_IDENTITY})


class TableError(HeronryError, ValueError):
    """A table cannot be used; the message says in one line why, and what to do."""

    def __init__(self, sentence: str) -> None:
        super().__init__(on_one_line(sentence))


@dataclass(frozen=True, slots=True)
class Port:
    """One bus of a PE, as the table of this PE describes it."""

    bus: str
    bitrate: int  # bit/s
    heartbeat_ns: int = field(metadata=OUTSIDE_IDENTITY)
    misses: int  # heartbeat periods of silence after which a channel or a radio counts as lost
    wireless: bool
    channels: int
    nodes: tuple[int, ...]  # node-IDs of the PEs that are reached through this port, directly or over gateways
    data_per_mille: int = 700  # share of data in the bit rate (`max_load` - `reserve`); management has the rest
    link_id: int | None = None  # identifier of the reports on this bus; None: this PE is not the gateway to a radio


@dataclass(frozen=True, slots=True)
class LeafEntry:
    """One input of a mode: a variable, in the versions `best` to `worst`."""

    path: str  # place of the input in the gates of the mode
    variable: str
    best: int
    worst: int


@dataclass(frozen=True, slots=True)
class ModeEntry:
    """One mode of a module."""

    name: str
    rate_mhz: int  # thousandths of a hertz
    cpu_millis: int  # thousandths of a processor core
    leaves: tuple[LeafEntry, ...]
    gives: dict[str, int]  # variable -> version


@dataclass(frozen=True, slots=True)
class ModuleEntry:
    """A module that may run on this PE."""

    index: int
    name: str
    image: str
    device: str | None
    demux: bool  # a branch of a DEMUX, or an end of its `to`: its output is exclusive
    movable: bool  # may run on other PEs too: its identifiers are exclusive
    modes: tuple[ModeEntry, ...]
    silent_output: bool = False  # its function has no actuator: only an output echo shows that it runs
    partition: str = ""  # modules of one partition share a process
    ram: int = 0  # bytes, in the mode that takes most
    restarts: int = 0  # how often the agent restarts it after a failure, before it counts as failed


@dataclass(frozen=True, slots=True)
class SourceEntry:
    """A pair (producing module, variable), with the identifier of its data frames and their longest period."""

    module: str
    variable: str
    identifier: int
    period_ns: int  # longest period of any mode that gives it: a slice does not name the mode of a remote producer
    movable: bool = False  # the module may run on either side of this gateway: forwarding to the uplink is exclusive


@dataclass(frozen=True, slots=True)
class VariableEntry:
    """Type and initial value of a variable."""

    type: str
    initial: int | float | str | tuple[int, ...] | None


@dataclass(frozen=True, slots=True)
class DeviceEntry:
    """A device and the node-ID of its PE."""

    name: str
    kind: Literal["sensor", "actuator"]
    node: int


@dataclass(frozen=True, slots=True)
class DriverEntry:
    """What a spec says of the driver of one of this PE's devices."""

    device: str
    driver: str | None  # a shipped one, an entry point, or `package.module:Class`; None: the node names it
    options: str  # JSON object: the driver's own options
    stale_ns: int  # a reading of a sensor that is older is not valid
    least: float | None  # `range` of a sensor, `limits` of an actuator; None: none
    most: float | None
    per_s: float | None  # `rate_limit` of an actuator; None: none
    safe: str | float  # what an actuator does without a command: "hold", "release", or a value


@dataclass(frozen=True, slots=True)
class CheckpointEntry:
    """The checkpoints of a module, as one PE sends them, keeps them, or forwards them as a gateway."""

    module: int  # index
    number: int  # of the module among those with checkpoints (`checkpoint_frames`)
    data_bytes: int  # of the longest state
    period_ns: int  # from one round to the next
    gap_ns: int  # from one frame of a round to the next
    max_age_ns: int
    late_ns: int | None  # most from `save` until the last frame arrives here; None: it has no bound
    towards: tuple[tuple[int, ...], ...]  # by port: node-IDs of the module's possible PEs that are reached through it
    waits_ns: tuple[int, ...]  # by port: how long a frame may wait for its bus, before it is dropped as late


@dataclass(frozen=True, slots=True)
class PhaseEntry:
    """A mission phase, and the rule by which it is entered: `variable` is above or below a threshold for `hold_ns`."""

    name: str
    variable: str | None = None  # None: no rule
    above: float | None = None
    below: float | None = None
    hold_ns: int = 0
    origins: tuple[int, ...] = ()  # indices of the phases from which the rule leads to this one


@dataclass(frozen=True)  # without slots: `identity` is computed once
class PeTable:
    """Everything that one PE is given of a spec."""

    protocol: Version  # of the manager that compiled the table
    spec: str
    spec_digest: str  # SHA-256 of what the spec means, hexadecimal
    name: str
    node_id: int
    cpu_millis: int  # thousandths of a processor core
    without_manager: Literal["keep", "safe_mode"]
    uplink: int  # the port toward the manager
    ports: tuple[Port, ...]
    modules: tuple[ModuleEntry, ...]
    sources: tuple[SourceEntry, ...]
    variables: dict[str, VariableEntry]
    devices: tuple[DeviceEntry, ...]
    module_names: tuple[str, ...]  # of the whole spec; EMCY uses their indices
    pe_names: tuple[str, ...] = ()  # of the whole spec
    bus_names: tuple[str, ...] = ()  # of the whole spec
    phases: tuple[PhaseEntry, ...] = ()  # of the whole spec, in its order
    adjustable: dict[str, int] = field(default_factory=dict)  # functions whose priority a module may change: indices
    flight_critical: tuple[str, ...] = ()  # devices and modules that may serve a function of class A, as KIND:NAME
    contingencies: str = field(default="", metadata=OUTSIDE_IDENTITY)  # on board (`contingency_block`), in base64
    # How often each output of this PE is echoed, at most (protocol rule 14).
    echoes_per_s: int = field(default=10, metadata=OUTSIDE_IDENTITY)
    # Period of LEASE: the slowest heartbeat on its way to this PE; 0: that of the uplink.
    command_period_ns: int = field(default=0, metadata=OUTSIDE_IDENTITY)
    # Of this PE's devices, those of whose driver the spec says something.
    drivers: tuple[DriverEntry, ...] = added_in(2, ())
    # Of the modules that may run here, and of those whose states this PE forwards.
    checkpoints: tuple[CheckpointEntry, ...] = added_in(3, (), told_if_any=True)

    @cached_property
    def identity(self) -> bytes:
        """The digest (32 bytes) of what digests of slices cover of this table (head of this file)."""
        return hashlib.sha256(json.dumps(self, separators=_COMPACT, default=_identifying).encode()).digest()

    def with_partitions(self, partitions: Mapping[int, str]) -> Self:
        """Return this table with other partitions of some modules, by index, and with the same identity.

        In which processes a node runs its modules is its own matter, as long as it parts what its manager has parted.
        So the text form stays that of the manager's table.
        """
        modules = tuple(replace(one, partition=partitions.get(one.index, one.partition)) for one in self.modules)
        changed = replace(self, modules=modules)
        vars(changed).update(identity=self.identity, compiled=self)
        return changed

    @property
    def compiled_form(self) -> "PeTable":
        """The table as the manager has compiled it, with the partitions that it parts."""
        compiled: PeTable = vars(self).get("compiled", self)
        return compiled

    def to_json(self) -> str:
        """Return the table as text in one line, with the keys in a fixed order and the check sum at the end."""
        return with_check_sum(_record(self.compiled_form))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read the text form; raises TableError."""
        try:
            raw = json.loads(text)
        except (ValueError, RecursionError) as error:
            if _SPEC.search(text):
                raise TableError(f"the text is a spec, not a table; {_COMPILE}") from None
            raise TableError(f"the table is not JSON ({error}); {_REMEDY}") from None
        if not isinstance(raw, dict):
            raise TableError(f"the table is not a JSON object; {_REMEDY}")
        version = _checked_version(raw)
        table: Self = _Reader(version.minor).read(cls, raw, "table")
        _check(table)
        return table

    def preloaded(self) -> tuple[Preloaded, ...]:
        """Return the contingencies on board, the first of which has number 1; raises TableError."""
        try:
            return read_block(b64decode(self.contingencies, validate=True))
        except (PackingError, ValueError) as error:
            raise TableError(f"the contingencies of the table cannot be read ({error}); {_REMEDY}") from None

    def leaf_counts(self) -> dict[tuple[int, int], int]:
        """Return the number of leaves of each mode, by (module index, mode index)."""
        return {(m.index, i): len(mode.leaves) for m in self.modules for i, mode in enumerate(m.modes)}


def with_check_sum(content: Mapping[str, Any]) -> str:
    """Return the text of a table with this content (values that are records may be dataclasses), and its check sum."""
    return json.dumps({**content, _CHECK_SUM: _check_sum(content)}, separators=_COMPACT, default=_record)


def _check_sum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, separators=_COMPACT, default=_record).encode()).hexdigest()


def _checked_version(raw: dict[str, Any]) -> Version:
    """Take the check sum off a table's JSON object, and give its version of the protocol; raises TableError.

    The version is looked at first, since another major may prove a table in another way.
    """
    told = raw.get("protocol")
    if told is None:
        raise TableError(f"the table names no version of the protocol; {_REMEDY}")
    version: Version = _Reader(0).read(Version, told, "table.protocol")
    if version.major != PROTOCOL.major:
        raise TableError(
            f"the table is of protocol {version}, and this agent speaks {PROTOCOL}: install the same major version of "
            "heronry for manager and PE, and write the table anew with 'heronry table'"
        )
    told_sum = raw.pop(_CHECK_SUM, None)
    try:
        fits = told_sum == _check_sum(raw)
    except RecursionError:  # deeper than any table, and just not too deep to be parsed
        fits = False
    if not fits:
        what = "lacks its check sum" if told_sum is None else "is damaged: its check sum does not fit"
        raise TableError(f"the table {what}; {_REMEDY}")
    return version


def _record(one: Any) -> dict[str, Any]:
    told = {f.name: getattr(one, f.name) for f in fields(type(one))}
    for f in fields(type(one)):
        if f.metadata.get("told_if_any") and told[f.name] == f.default:
            del told[f.name]
    return told


def _identifying(one: Any) -> dict[str, Any]:
    return {f.name: getattr(one, f.name) for f in fields(type(one)) if f.metadata.get("identity", True)}


def _check(table: PeTable) -> None:
    known = {device.name for device in table.devices}
    drivers = (fault for driver in table.drivers for fault in _driver_faults(driver, known))
    for fault in chain(_faults(table), drivers, _checkpoint_faults(table)):
        raise TableError(f"{fault}; {_REMEDY}")


def _faults(table: PeTable) -> Iterator[str]:
    """Yield a sentence for each contradiction between the fields of a table.

    The caller has checked that all fields have the right types.
    """
    if table.node_id not in PE_NODES:
        yield f"node_id {table.node_id} is not a PE's; PEs have {PE_NODES[0]} to {PE_NODES[-1]}"
    if not 0 <= table.uplink < len(table.ports):
        yield f"uplink {table.uplink} names no port; there are {len(table.ports)}"
    if _SHA_256.fullmatch(table.spec_digest) is None:
        yield f"spec_digest {table.spec_digest:.70} is not a SHA-256 in hexadecimal"
    if table.echoes_per_s < 1:
        yield f"outputs are echoed {table.echoes_per_s} times a second, which must be positive"
    for port in table.ports:
        yield from _port_faults(port)
    for source in table.sources:
        if classify(source.identifier).use not in (Use.STANDARD_DATA, Use.ALLOCATED_DATA):
            yield f"{source.variable} of {source.module} has identifier {source.identifier}, which is not one for data"
    if len({module.index for module in table.modules}) != len(table.modules):
        yield "two modules have the same index"
    numbered = dict(enumerate(table.module_names))
    for module in table.modules:
        if numbered.get(module.index) != module.name:
            yield f"module {module.name} is not number {module.index} of module_names"
        for mode in module.modes:
            yield from _mode_faults(f"module {module.name}", mode, table.variables)


def _driver_faults(driver: DriverEntry, devices: Collection[str]) -> Iterator[str]:
    if driver.device not in devices:
        yield f"a driver is named for the unknown device {driver.device:.70}"
    if driver.stale_ns <= 0:
        yield f"readings of device {driver.device} may be {driver.stale_ns} ns old, which must be positive"
    if driver.per_s is not None and driver.per_s <= 0:
        yield f"device {driver.device} moves by {driver.per_s} units a second, which must be positive"
    if isinstance(driver.safe, str) and driver.safe not in ("hold", "release"):
        yield f"device {driver.device} has the safe action {driver.safe!r:.70}, which is none"
    try:
        options = json.loads(driver.options)
    except (ValueError, RecursionError):
        options = None
    if not isinstance(options, dict):
        yield f"the options of device {driver.device} are not a JSON object"


def _checkpoint_faults(table: PeTable) -> Iterator[str]:
    names = dict(enumerate(table.module_names))
    for one in table.checkpoints:
        subject = f"the checkpoint of module {names.get(one.module, one.module)}"
        if one.module not in names:
            yield f"{subject} is of no module of module_names"
        if not 0 <= one.number < MOST_CHECKPOINTS or not 0 < one.data_bytes <= MOST_STATE_BYTES:
            yield f"{subject} has number {one.number} and {one.data_bytes} bytes, which do not fit into its frames"
        if min(one.period_ns, one.gap_ns, one.max_age_ns) <= 0 or min(one.late_ns or 0, *one.waits_ns, 0) < 0:
            yield f"{subject} has a time that is not above 0"
        nodes = {node for way in one.towards for node in way}
        if {len(one.towards), len(one.waits_ns)} != {len(table.ports)} or not nodes.issubset(PE_NODES):
            yield f"{subject} goes to ports or nodes that do not exist"
    if len({one.number for one in table.checkpoints}) != len(table.checkpoints):
        yield "two checkpoints have the same number"


def _port_faults(port: Port) -> Iterator[str]:
    if port.bitrate <= 0:
        yield f"bus {port.bus} has {port.bitrate} bit/s, which must be positive"
    for node in port.nodes:
        if node not in PE_NODES:
            yield f"bus {port.bus} leads to node {node}, which is not a PE's"
    if not 0 < port.data_per_mille <= 1000:
        yield f"bus {port.bus} has {port.data_per_mille} thousandths for data, which must be 1 to 1000"
    if port.link_id is not None and port.link_id not in GATEWAY_IDS:
        yield f"the reports on bus {port.bus} have identifier {port.link_id}, which is not one for gateways"


def _mode_faults(module: str, mode: ModeEntry, variables: Collection[str]) -> Iterator[str]:
    for variable in (*mode.gives, *(leaf.variable for leaf in mode.leaves)):
        if variable not in variables:
            yield f"{module} names the unknown variable {variable}"
    if mode.rate_mhz <= 0:
        yield f"{module} has the rate {mode.rate_mhz} mHz, which must be positive"
    if mode.cpu_millis < 0:
        yield f"{module} takes {mode.cpu_millis} thousandths of a core, which must not be negative"


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads parsed JSON as records of a table.

    minor: of the table's protocol. If it is later than the agent's, a record may have fields that the agent skips; if
        a field was added after it, the record may lack the field.
    """

    minor: int

    def read(self, kind: Any, raw: Any, where: str) -> Any:
        """Read parsed JSON as a value of type `kind`; raises TableError where a part of it has another type.

        where: the place in the table, for the message.
        """
        origin, arguments = get_origin(kind), get_args(kind)
        if is_dataclass(kind) and isinstance(raw, dict):
            return self._record(kind, raw, where)
        if origin is tuple and isinstance(raw, list):
            return tuple(self.read(arguments[0], item, f"{where}[{i}]") for i, item in enumerate(raw))
        if origin is dict and isinstance(raw, dict):
            return {key: self.read(arguments[1], value, f"{where}.{key}") for key, value in raw.items()}
        if origin is Literal and raw in arguments:
            return raw
        if origin in (Union, UnionType):
            for option in arguments:
                try:
                    return self.read(option, raw, where)
                except TableError:
                    continue
        if kind in (int, str, bool, type(None)) and type(raw) is kind:
            return raw
        if kind is float and type(raw) is float and math.isfinite(raw):
            return raw
        raise TableError(f"{where} holds {reprlib.repr(raw)}, which has the wrong type; {_REMEDY}")

    def _needs(self, metadata: Mapping[str, Any]) -> bool:
        """Tell whether a table of this minor must have a field with this metadata."""
        return metadata.get("since", 0) <= self.minor and not metadata.get("told_if_any", False)

    def _record(self, kind: Any, raw: dict[str, Any], where: str) -> Any:
        known = {f.name: f for f in fields(kind)}
        missing = [name for name, f in known.items() if name not in raw and self._needs(f.metadata)]
        unknown = [name for name in raw if name not in known] if self.minor <= PROTOCOL.minor else []
        odd = sorted(missing + unknown)
        if odd:
            raise TableError(
                f"{where} has missing or unknown fields ({', '.join(f'{key:.40}' for key in odd[:5])}); {_REMEDY}"
            )
        present = {name: f for name, f in known.items() if name in raw}
        return kind(**{name: self.read(f.type, raw[name], f"{where}.{name}") for name, f in present.items()})
