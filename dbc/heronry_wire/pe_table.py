"""The table of one PE: all of a spec that a PE needs, compiled by the manager, read by the agent.

The agent knows no graph and no YAML. What a slice says in indices, the table explains: modules and their modes and
leaves, sources and their identifiers, and which nodes lie behind which bus. It travels as JSON text (UTF-8, stdlib
only), written by `PeTable.to_json` and read by `PeTable.from_json`, which refuses what it does not understand with one
sentence and never builds half a table.

Indices: modules, devices and buses count in the spec's order, over the whole spec. A *source* is a pair (producing
module, variable), counted in the order of `Spec.sources`. A *port* is one of this PE's buses, in the order of its
`buses`.
"""

import json
from dataclasses import asdict, dataclass, fields, is_dataclass
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from heronry_wire.errors import HeronryError

FORMAT = 1


class TableError(HeronryError, ValueError):
    """A table that cannot be used; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Port:
    """One bus this PE sits on."""

    bus: str
    bitrate: int  # bit/s
    heartbeat_ns: int
    misses: int
    wireless: bool
    channels: int
    nodes: tuple[int, ...]  # PEs that are reached through this port, directly or over gateways


@dataclass(frozen=True, slots=True)
class LeafEntry:
    """One input of a mode."""

    path: str
    variable: str
    best: int
    worst: int


@dataclass(frozen=True, slots=True)
class ModeEntry:
    """One mode of a module."""

    name: str
    rate_mhz: int
    cpu_millis: int
    leaves: tuple[LeafEntry, ...]
    gives: dict[str, int]  # variable -> version


@dataclass(frozen=True, slots=True)
class ModuleEntry:
    """A module that may run on this PE."""

    index: int
    name: str
    image: str
    device: str | None
    demux: bool  # a branch of a DEMUX: its output is exclusive
    movable: bool  # may run on other PEs too: its identifiers are exclusive
    modes: tuple[ModeEntry, ...]
    silent_output: bool = False  # it serves a function and drives no actuator: only an echo shows that it runs


@dataclass(frozen=True, slots=True)
class SourceEntry:
    """A (producing module, variable) pair, the identifier of its data frames, and how long one may be waited for."""

    module: str
    variable: str
    identifier: int
    period_ns: int  # the longest over the modes that give it: a slice does not say in which one its producer runs


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
class PeTable:
    """Everything one PE knows of a spec."""

    format: int
    spec: str
    spec_digest: str  # SHA-256 of the spec, hexadecimal
    name: str
    node_id: int
    cpu_millis: int
    without_manager: Literal["keep", "safe_mode"]
    uplink: int  # the port toward the manager
    ports: tuple[Port, ...]
    modules: tuple[ModuleEntry, ...]
    sources: tuple[SourceEntry, ...]
    variables: dict[str, VariableEntry]
    devices: tuple[DeviceEntry, ...]
    module_names: tuple[str, ...]  # of the whole spec: EMCY counts in it

    def to_json(self) -> str:
        """Text form, one line, keys in a fixed order."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @staticmethod
    def from_json(text: str) -> "PeTable":
        """Read the text form; raises TableError."""
        try:
            raw = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise TableError(f"the table is not JSON ({error}); write it anew with 'heronry table'") from None
        if not isinstance(raw, dict) or raw.get("format") != FORMAT:
            raise TableError(f"the table is not of format {FORMAT}; write it anew with 'heronry table'")
        table: PeTable = _read(PeTable, raw, "table")
        _check(table)
        return table

    def leaf_counts(self) -> dict[tuple[int, int], int]:
        """Number of leaves of each (module index, mode index): what `decode_slice` needs."""
        return {(m.index, i): len(mode.leaves) for m in self.modules for i, mode in enumerate(m.modes)}


def _check(table: PeTable) -> None:
    if not 92 <= table.node_id <= 125:
        raise TableError(f"node_id {table.node_id} is not a PE's; PEs have 92 to 125")
    if not 0 <= table.uplink < len(table.ports):
        raise TableError(f"uplink {table.uplink} names no port; there are {len(table.ports)}")
    for module in table.modules:
        for mode in module.modes:
            unknown = [v for v in (*mode.gives, *(leaf.variable for leaf in mode.leaves)) if v not in table.variables]
            if unknown:
                raise TableError(f"module {module.name} names the unknown variable {unknown[0]}")
            if mode.rate_mhz <= 0:
                raise TableError(f"module {module.name} has the rate {mode.rate_mhz} mHz; it must be positive")


def _read(kind: Any, raw: Any, where: str) -> Any:
    """Read plain JSON data as `kind`, strictly; raises TableError with the place."""
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind) and isinstance(kind, type):
        return _read_record(kind, raw, where)
    if origin is tuple and isinstance(raw, list):
        return tuple(_read(arguments[0], item, f"{where}[{i}]") for i, item in enumerate(raw))
    if origin is dict and isinstance(raw, dict):
        return {key: _read(arguments[1], value, f"{where}.{key}") for key, value in raw.items()}
    if origin is Literal and raw in arguments:
        return raw
    if origin in (Union, UnionType):
        for option in arguments:
            try:
                return _read(option, raw, where)
            except TableError:
                continue
    if kind is type(None) and raw is None:
        return None
    if isinstance(kind, type) and kind in (int, float, str, bool) and type(raw) is kind:
        return raw
    raise TableError(f"{where} holds {raw!r:.60}, which does not fit; write the table anew with 'heronry table'")


def _read_record(kind: Any, raw: Any, where: str) -> Any:
    names = {f.name for f in fields(kind)}
    if not isinstance(raw, dict) or set(raw) != names:
        odd = sorted(set(raw) ^ names) if isinstance(raw, dict) else [type(raw).__name__]
        raise TableError(f"{where} has missing or unknown keys: {', '.join(map(str, odd))}")
    return kind(**{f.name: _read(f.type, raw[f.name], f"{where}.{f.name}") for f in fields(kind)})
