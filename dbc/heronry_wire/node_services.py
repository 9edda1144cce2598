"""CANaerospace node services: requests to one node or to all, and their answers.

This file encodes and decodes the channel, direction and service of a frame, and the bytes of a request or an answer
(CANaerospace V1.7 p.10-23). It keeps no state.

    request    carries the node-ID that it addresses (0: all nodes). Its identifier on channel c is 128 + 2c (c = 0..35)
               or 2000 + 2(c - 100) (c = 100..115). The sender repeats it if no answer comes within 100 ms (V1.7)
    answer     carries the node-ID of its sender. Its identifier is that of the request plus 1

Every node answers a request to all nodes, if the service has answers. Node n waits (n - 92) ms first, so that the
answers do not all start together.

Every node of this project answers IDS (identification) on channel 0. A PE also executes TIS (transmission interval),
STS (state transmission) and NSS (synchronisation) on this channel. No program of this project sends the other services.
A program that needs them for a unit of another maker encodes the request with `request`, and decodes the answer with
`decode_service`. This file does not split or join the data blocks of DDS (data download) and DUS (data upload).

Channel 110 is never used here, since its identifiers belong to CANopen (LSS).
"""

from enum import IntEnum
from typing import NamedTuple

from heronry_wire.canaerospace import DataType, Datum, Value, decode_data, encode_data
from heronry_wire.frame import Frame, Malformed, WireError
from heronry_wire.identifiers import FIRST_PE, HIGH_SERVICE_IDS, LOW_SERVICE_IDS, LSS_IDS

BROADCAST = 0

_NS_PER_MS = 1_000_000
_FIRST_LOW_CHANNEL = 100


class Service(IntEnum):
    """Service codes, byte 2 of a node service frame (V1.7 p.11); 16..99 are reserved, 100..255 free."""

    IDS = 0  # identification
    NSS = 1  # node synchronisation; no answer
    DDS = 2  # data download: to the node
    DUS = 3  # data upload: from the node
    SCS = 4  # simulation control
    TIS = 5  # transmission interval
    FPS = 6  # flash programming: store the configuration
    STS = 7  # state transmission: send everything once; no answer
    FSS = 8  # filter setting
    TCS = 9  # test control
    BSS = 10  # baud rate setting; answered only on failure
    NIS = 11  # node-ID setting
    MIS = 12  # module information
    MCS = 13  # module configuration
    CSS = 14  # CAN identifier setting
    DSS = 15  # distribution setting


class Result(IntEnum):
    """Result of a service request, in the message code of an answer; a signed byte.

    An answer to DDS or DUS has the result in its value, a LONG. In an answer to DDS, 0 means XOFF (wait) and 1 means
    XON (go on).
    """

    OUT_OF_RANGE = -6
    WRONG_CODE = -3
    INVALID = -2
    ABORT = -1
    OK = 0
    XON = 1

    @property
    def message_code(self) -> int:
        """The result as an unsigned byte, for the message code of a frame."""
        return self & 0xFF


class ServiceMessage(NamedTuple):
    """A request or an answer of a node service.

    datum: its `service_code` is the service. Its `node_id` is the addressed node in a request, and the sender in an
        answer.
    """

    channel: int
    is_answer: bool
    datum: Datum


class Identification(NamedTuple):
    """The four bytes of an answer to IDS, each 0..255.

    `distribution` 0 is the distribution of CANaerospace V1.7, and `header_type` 0 is its header type.
    """

    hardware_revision: int
    software_revision: int
    distribution: int = 0
    header_type: int = 0


def service_id(channel: int, *, is_answer: bool) -> int:
    """Return the identifier of a channel's requests, or of its answers; raises WireError for an unknown channel."""
    low = channel >= _FIRST_LOW_CHANNEL
    ids, index = (LOW_SERVICE_IDS, channel - _FIRST_LOW_CHANNEL) if low else (HIGH_SERVICE_IDS, channel)
    if not 0 <= 2 * index < len(ids) or ids[2 * index] in LSS_IDS:
        raise WireError(f"service channel {channel} does not exist here: use 0..35 or 100..115, except 110")
    return ids[2 * index] + is_answer


def encode_service(message: ServiceMessage) -> Frame:
    """Return the frame of a node service message."""
    return encode_data(service_id(message.channel, is_answer=message.is_answer), message.datum)


def decode_service(frame: Frame) -> ServiceMessage | Malformed:
    """Decode a node service frame; `Malformed` for any other frame."""
    if frame.extended or frame.can_id in LSS_IDS:
        return Malformed("not a node service frame")
    if frame.can_id in HIGH_SERVICE_IDS:
        channel, is_answer = divmod(frame.can_id - HIGH_SERVICE_IDS[0], 2)
    elif frame.can_id in LOW_SERVICE_IDS:
        channel, is_answer = divmod(frame.can_id - LOW_SERVICE_IDS[0], 2)
        channel += _FIRST_LOW_CHANNEL
    else:
        return Malformed("not a node service frame")
    datum = decode_data(frame)
    return datum if isinstance(datum, Malformed) else ServiceMessage(channel, is_answer == 1, datum)


def request(
    service: int,
    node_id: int,
    *,
    channel: int = 0,
    data_type: DataType | int = DataType.NODATA,
    message_code: int = 0,
    value: Value = None,
) -> ServiceMessage:
    """Make a request to a node (0: all nodes).

    IDS, STS, FPS, NIS and DSS carry a message code and no value.
    """
    return ServiceMessage(channel, is_answer=False, datum=Datum(node_id, data_type, service, message_code, value))


def answer(
    request: ServiceMessage,
    node_id: int,
    *,
    data_type: DataType | int = DataType.NODATA,
    message_code: int = 0,
    value: Value = None,
) -> ServiceMessage:
    """Make the answer of node `node_id` to a request; channel and service are those of the request."""
    datum = Datum(node_id, data_type, request.datum.service_code, message_code, value)
    return ServiceMessage(request.channel, is_answer=True, datum=datum)


def answer_identification(request: ServiceMessage, node_id: int, own: Identification) -> ServiceMessage:
    """Make the answer of node `node_id` to an IDS request, with the message code of the request."""
    code = request.datum.message_code
    return answer(request, node_id, data_type=DataType.UCHAR4, message_code=code, value=tuple(own))


def read_identification(message: ServiceMessage) -> Identification | Malformed:
    """Return the identification in an answer to IDS; `Malformed` for any other message."""
    _, data_type, service, _, value = message.datum
    right = message.is_answer and service == Service.IDS and data_type == DataType.UCHAR4
    if not right or not isinstance(value, tuple):
        return Malformed("not an answer to IDS, which has four unsigned bytes")
    return Identification(*value)


def answer_delay_ns(request: ServiceMessage, node_id: int) -> int:
    """Return how long (ns) a node waits before it answers: by its node-ID, if the request was for all nodes."""
    return (node_id - FIRST_PE) * _NS_PER_MS if request.datum.node_id == BROADCAST else 0
