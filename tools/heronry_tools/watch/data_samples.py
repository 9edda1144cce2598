"""What the data frames of a spec carry: of which source a frame is, and its numbers.

A *source* is a variable as one module gives it; its frames have one identifier on every bus. A frame with this
identifier is a sample of the source, unless a PE that reads the source would refuse it: for another type, no version,
or a sender on which the module cannot run. A forged frame with the right head looks like a true one, since data carry
no tag.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from heronry_dg.model import Spec, Variable
from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.traffic import identifiers
from heronry_wire.canaerospace import DataType, Status, Validity, decode_data, unpack_status
from heronry_wire.frame import Frame, Malformed
from heronry_wire.protocol_times import FRESH_PERIODS

_USABLE = (Validity.NOT_STATED, Validity.VALID, Validity.DEGRADED)
_TEXTS_AND_NOTHING = ("ACHAR", "NODATA", "ERROR")


@dataclass(frozen=True, slots=True)
class DataSource:
    """A variable as one module gives it.

    identifier: of its frames.
    parts: how many numbers a datum has, 1 to 4; 1 also for a text.
    nodes: node-IDs of the PEs on which the module may run.
    fresh_ns: how long a reader uses a datum after it came.
    """

    producer: str
    variable: str
    identifier: int
    data_type: DataType
    parts: int
    nodes: frozenset[int]
    fresh_ns: int


class DataSample(NamedTuple):
    """One datum: its numbers (none if it is a text or has no value), and what its head says of it."""

    numbers: tuple[float, ...]
    version: int  # 1 is the best
    is_usable: bool  # false: invalid, or a number that is infinite or none
    node: int
    message_code: int


def data_sources(spec: Spec) -> Mapping[int, DataSource]:
    """Return every source of a spec, in the spec's order, by the identifier of its frames."""
    return {can_id: _source(spec, *source, can_id) for source, can_id in identifiers(spec).items()}


def has_numbers(variable: Variable) -> bool:
    """Tell whether the data of a variable are numbers."""
    return not variable.type.startswith(_TEXTS_AND_NOTHING)


def sample_of(source: DataSource, frame: Frame) -> DataSample | Malformed:
    """Read a frame with the identifier of a source; `Malformed` with the reason for which a PE would refuse it."""
    datum = Malformed("a frame with 29 bits of identifier") if frame.extended else decode_data(frame)
    if isinstance(datum, Malformed):
        return datum
    if datum.data_type != source.data_type:
        return Malformed(f"a frame of type {datum.data_type}, where {source.variable} has type {source.data_type.name}")
    if datum.node_id not in source.nodes:
        return Malformed(f"a frame of node {datum.node_id}, on which {source.producer} cannot run")
    status = unpack_status(datum.service_code)
    if not isinstance(status, Status):
        return status
    values = datum.value if isinstance(datum.value, tuple) else (datum.value,)
    numbers = tuple(value for value in values if isinstance(value, int | float))
    is_usable = status.validity in _USABLE and all(map(math.isfinite, numbers))
    return DataSample(numbers, status.version, is_usable, datum.node_id, datum.message_code)


def _source(spec: Spec, producer: str, name: str, can_id: int) -> DataSource:
    module, data_type = spec.modules[producer], DataType[spec.variables[name].type]
    slowest_mhz = min(mode.rate_mhz for mode in module.modes.values() if name in mode.gives)
    return DataSource(
        producer,
        name,
        can_id,
        data_type,
        _parts(data_type.name),
        frozenset(spec.pes[pe].node_id for pe in hosts_when_all_is_up(spec, module)),
        FRESH_PERIODS * 10**12 // slowest_mhz,
    )


def _parts(data_type: str) -> int:
    return int(data_type[-1]) if data_type[-1].isdigit() and not data_type.startswith("ACHAR") else 1
