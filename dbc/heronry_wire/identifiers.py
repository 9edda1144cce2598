"""The identifier plan: which node sends which frame under which of the 2 048 standard identifiers.

This file gives the identifier of every frame that this project sends, the meaning of an identifier on the bus, and the
identifier of each (variable, producing module). CANaerospace and CANopen share the bus without one collision, and a
node has the same number in both:

    0              CANopen NMT                           (so emergency event 0 is never used)
    1..127         emergency event of node n: n          CANaerospace EED
    128..199       node services, high channels 0..35    CANaerospace NSH
    200..219       management, ten for each manager      CANaerospace UDH: free for the user
    220..255       CANopen EMCY of node n: 128 + n       UDH
    256            CANopen TIME                          UDH
    257..290       state of PE n: 165 + n                UDH
    291..299       gateways                              UDH
    300..1499      data with a standard identifier       CANaerospace NOD
    1500..1535     SDO, server to client: 1408 + n       NOD, unassigned
    1536..1627     data, allocated                       NOD, unassigned
    1628..1663     SDO, client to server: 1536 + n       NOD, unassigned
    1664..1792     data, allocated                       NOD, unassigned
    1884..1919     CANopen heartbeat of node n: 1792 + n UDL and DSD: free for the user
    1920..1953     actuator echo of PE n: 1828 + n       CANaerospace DSD: debug and download
    1954..1987     checkpoint of PE n: 1862 + n          DSD
    1988..1999     bulk, debug                           DSD
    2000..2031     node services, low channels 100..115  CANaerospace NSL, without 2020 and 2021 (CANopen LSS)

Ranges: CANaerospace V1.7 p.4-5, CiA 301 section 7.3. CANopen SYNC, PDOs and LSS fall on CANaerospace
identifiers and are not used.

This file keeps no state: the plan is fixed, and an allocation depends only on its input. So two programs that read the
same spec use the same identifiers. The plan covers 11-bit data frames only: a receiver checks the extended and the
remote flag first.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import NamedTuple

from heronry_wire.frame import WireError

FIRST_PE, LAST_PE = 92, 125
FIRST_MANAGER, LAST_MANAGER = 126, 127

PE_NODES = range(FIRST_PE, LAST_PE + 1)
MANAGER_NODES = range(FIRST_MANAGER, LAST_MANAGER + 1)
NODES = range(FIRST_PE, LAST_MANAGER + 1)

NMT_ID = 0
TIME_ID = 256
EMERGENCY_EVENT_IDS = range(1, 128)
HIGH_SERVICE_IDS = range(128, 200)
LOW_SERVICE_IDS = range(2000, 2032)
LSS_IDS = range(2020, 2022)
GATEWAY_IDS = range(291, 300)
STANDARD_DATA_IDS = range(300, 1500)
ALLOCATED_DATA_IDS = (*range(1536, 1628), *range(1664, 1793))
BULK_IDS = range(1988, 2000)

_EMCY_BASE = 128
_STATE_BASE = 165
_SDO_RESPONSE_BASE = 1408
_SDO_REQUEST_BASE = 1536
_HEARTBEAT_BASE = 1792
_ECHO_BASE = 1920 - FIRST_PE
_CHECKPOINT_BASE = 1954 - FIRST_PE
_MANAGEMENT_BASE = 200
_MANAGEMENT_STEP = 10


class Command(IntEnum):
    """Kind of a management frame; the value is its position among the ten identifiers of its manager."""

    LEASE = 0
    ALIVE = 1
    PREPARE = 2
    SLICE = 3
    ACTIVATE = 4  # with the step BREAK, GO or GO_ALL
    PING = 5
    CONTROL = 6
    TAG = 7


class Use(Enum):
    """What an identifier is used for."""

    NMT = auto()
    EMERGENCY_EVENT = auto()
    NODE_SERVICE = auto()
    MANAGEMENT = auto()
    EMCY = auto()
    TIME = auto()
    STATE = auto()
    GATEWAY = auto()
    STANDARD_DATA = auto()
    SDO_RESPONSE = auto()
    SDO_REQUEST = auto()
    ALLOCATED_DATA = auto()
    HEARTBEAT = auto()
    ACTUATOR_ECHO = auto()
    CHECKPOINT = auto()
    BULK = auto()
    UNASSIGNED = auto()


class Meaning(NamedTuple):
    """Meaning of an identifier.

    node_id, command: the node and the management command to which the identifier belongs; None: to no single one.
    """

    use: Use
    node_id: int | None = None
    command: Command | None = None


def emergency_event_id(node_id: int) -> int:
    """Return the identifier of the emergency events of a node, 1..127."""
    return _checked(node_id, EMERGENCY_EVENT_IDS, "any node")


def emcy_id(node_id: int) -> int:
    """Return the CANopen EMCY identifier of a PE or manager."""
    return _EMCY_BASE + _checked(node_id, NODES, "a PE or manager")


def state_id(node_id: int) -> int:
    """Return the identifier of the state frame of a PE."""
    return _STATE_BASE + _checked(node_id, PE_NODES, "a PE")


def sdo_response_id(node_id: int) -> int:
    """Return the identifier of the answers of the SDO server of a node."""
    return _SDO_RESPONSE_BASE + _checked(node_id, NODES, "a PE or manager")


def sdo_request_id(node_id: int) -> int:
    """Return the identifier of the requests to the SDO server of a node."""
    return _SDO_REQUEST_BASE + _checked(node_id, NODES, "a PE or manager")


def heartbeat_id(node_id: int) -> int:
    """Return the identifier of the one-byte CANopen heartbeat of a node."""
    return _HEARTBEAT_BASE + _checked(node_id, NODES, "a PE or manager")


def actuator_echo_id(node_id: int) -> int:
    """Return the identifier of the output echo of a PE."""
    return _ECHO_BASE + _checked(node_id, PE_NODES, "a PE")


def checkpoint_id(node_id: int) -> int:
    """Return the identifier of the checkpoints that a PE sends."""
    return _CHECKPOINT_BASE + _checked(node_id, PE_NODES, "a PE")


def management_id(manager: int, command: Command) -> int:
    """Return the identifier of a management command of a manager, whose node-ID is 126 or 127."""
    index = _checked(manager, MANAGER_NODES, "a manager") - FIRST_MANAGER
    return _MANAGEMENT_BASE + _MANAGEMENT_STEP * index + command


def _checked(node_id: int, allowed: range, kind: str) -> int:
    if node_id not in allowed:
        raise WireError(f"{node_id} is not the node-ID of {kind}: use {allowed[0]}..{allowed[-1]}")
    return node_id


def planned_uses() -> Iterable[tuple[int, Meaning]]:
    """Return every identifier to which this project assigns a meaning, with this meaning.

    Identifiers that are not in the result are unassigned.
    """
    yield NMT_ID, Meaning(Use.NMT)
    yield TIME_ID, Meaning(Use.TIME)
    for node in EMERGENCY_EVENT_IDS:
        yield node, Meaning(Use.EMERGENCY_EVENT, node)
    for node in NODES:
        yield emcy_id(node), Meaning(Use.EMCY, node)
        yield sdo_response_id(node), Meaning(Use.SDO_RESPONSE, node)
        yield sdo_request_id(node), Meaning(Use.SDO_REQUEST, node)
        yield heartbeat_id(node), Meaning(Use.HEARTBEAT, node)
    for node in PE_NODES:
        yield state_id(node), Meaning(Use.STATE, node)
        yield actuator_echo_id(node), Meaning(Use.ACTUATOR_ECHO, node)
        yield checkpoint_id(node), Meaning(Use.CHECKPOINT, node)
    for node in MANAGER_NODES:
        for command in Command:
            yield management_id(node, command), Meaning(Use.MANAGEMENT, node, command)
    service_ids = [i for i in (*HIGH_SERVICE_IDS, *LOW_SERVICE_IDS) if i not in LSS_IDS]
    for ids, use in (
        (service_ids, Use.NODE_SERVICE),
        (GATEWAY_IDS, Use.GATEWAY),
        (STANDARD_DATA_IDS, Use.STANDARD_DATA),
        (ALLOCATED_DATA_IDS, Use.ALLOCATED_DATA),
        (BULK_IDS, Use.BULK),
    ):
        for can_id in ids:
            yield can_id, Meaning(use)


_UNASSIGNED = Meaning(Use.UNASSIGNED)
_MEANINGS = dict(planned_uses())


def classify(can_id: int) -> Meaning:
    """Return the meaning of an 11-bit identifier; its use is UNASSIGNED where the plan does not have the identifier."""
    return _MEANINGS.get(can_id, _UNASSIGNED)


@dataclass(frozen=True, slots=True)
class Source:
    """A pair (producing module, variable), which needs an identifier.

    standard: the standard identifier that the spec gives the variable; None if it gives none.
    best_version: the version in which the producer gives the variable in the first of its modes, in the order of the
        spec, that give it.
    criticality_rank: best criticality of the functions that the source serves, in any phase: 0 (A) .. 4 (E).
    rate_mhz: rate at which the variable is sent, in thousandths of a hertz.
    order: position of the source in the spec.
    """

    producer: str
    variable: str
    standard: int | None
    best_version: int
    criticality_rank: int
    rate_mhz: int
    order: int


def allocate(sources: Iterable[Source]) -> dict[tuple[str, str], int]:
    """Allocate an identifier to every (producer, variable).

    - If a variable has a standard identifier, one producer gets it: the one with the lowest `best_version`; of equal
      ones, the first in the spec.
    - Every other pair gets an allocated identifier. The highest priority on the bus goes to the most critical source;
      of equal ones, to the one with the highest rate; then to the first in the spec.

    Raises WireError if more than 221 identifiers would have to be allocated, if two sources are the same pair, or if a
    standard identifier is outside 300..1499 or claimed by two variables.
    """
    ordered = sorted(sources, key=lambda source: source.order)
    pairs = {(source.producer, source.variable) for source in ordered}
    if len(pairs) != len(ordered):
        raise WireError("a (producer, variable) pair is listed twice: give one Source for each pair")
    given = {(s.producer, s.variable): can_id for can_id, s in _standard_holders(ordered).items()}
    rest = [s for s in ordered if (s.producer, s.variable) not in given]
    rest.sort(key=lambda s: (s.criticality_rank, -s.rate_mhz))
    if len(rest) > len(ALLOCATED_DATA_IDS):
        raise WireError(
            f"{len(rest)} (module, variable) pairs need an allocated identifier, but there are only "
            f"{len(ALLOCATED_DATA_IDS)}: give variables a standard identifier, or merge variables"
        )
    for source, can_id in zip(rest, ALLOCATED_DATA_IDS, strict=False):
        given[source.producer, source.variable] = can_id
    return given


def _standard_holders(ordered: list[Source]) -> dict[int, Source]:
    holders: dict[int, Source] = {}
    for source in ordered:
        if source.standard is None:
            continue
        if source.standard not in STANDARD_DATA_IDS:
            raise WireError(f"variable {source.variable}: {source.standard} is no standard identifier, use 300..1499")
        holder = holders.setdefault(source.standard, source)
        if holder.variable != source.variable:
            raise WireError(
                f"variables {holder.variable} and {source.variable} both claim identifier {source.standard}: "
                "let only one of them have it"
            )
        if source.best_version < holder.best_version:
            holders[source.standard] = source
    return holders
