"""The management protocol: every message between a manager and the PEs, and its bytes.

*Senders.* The manager (node 126 or 127) sends LEASE and ALIVE every heartbeat period, PREPARE, SLICE and ACTIVATE when
it reconfigures, PING to a suspect PE, and CONTROL for an `Operation`. With a key, a TAG follows each of these commands
(`command_tags`). A PE sends STATE every heartbeat period (`state_frames`), and EMCY for a fault or a request. A gateway
also sends LINK (`gateway_report`). There are no other commands or reports.

*Reconfiguration: stage, then activate.* PREPARE names a new epoch and the digest of its configuration. If the
configuration is a contingency, PREPARE also gives the number of the contingency. Then each PE stages its slice:

- A PE that has the contingency on board takes its slice from there.
- For each other PE, SLICE with index 0 gives the length and the digest of its slice. If the PE already runs a slice
  with this digest, it stages this slice. If not, it collects the slice from the SLICE frames 1, 2, ..., with five
  bytes each. They may come in any order, and doubled.

Page 1 of the state reports what is staged. ACTIVATE then carries a step. LEASE repeats the step, for a PE that missed
ACTIVATE. What a PE does at each step:

    BREAK    stops modules that the new slice lacks, rewires those that stay, sends no new data, reports BROKEN
    GO       starts the other modules, but holds DEMUX branches that are new on this PE; reports PARTIAL if it holds one
    GO_ALL   starts these branches, too; reports ACTIVE

A step contains the steps before it, so one ACTIVATE with GO_ALL is enough where nothing exclusive moves. PREPARE,
SLICE, ACTIVATE and LEASE may be lost, late or doubled, since each names its epoch (SLICE modulo 256). A PE ignores an
older epoch, a lower term, and a step that it has already taken.

*Numbers.* Epochs are compared modulo 2^16 (`is_newer`); 0 means that there is no epoch. A term is 1..4095 (PREPARE has
no room for more) and only rises; any other value is malformed. A digest is 24 bits. All numbers are big-endian, except
the error code in EMCY, which is little-endian as in CiA 301.

Malformed bytes decode to `Malformed` with a reason; encoding a number that does not fit raises ValueError.

Source: docs/protocol.md, protocol rules 1 to 8; CiA 301 7.2.7 (EMCY), 7.2.8.3.2 (heartbeat).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from heronry_wire.frame import Malformed
from heronry_wire.identifiers import FIRST_PE, PE_NODES, Command
from heronry_wire.layout import Field, Layout

MAX_TERM = 0xFFF
NO_EPOCH = 0
SLICE_BYTES_PER_FRAME = 5


class Step(IntEnum):
    """Activation steps of an epoch; each step contains the steps before it."""

    PREPARED = 0
    BREAK = 1
    GO = 2
    GO_ALL = 3


class Operation(IntEnum):
    """Operations of CONTROL; `a` and `b` are its arguments."""

    ACKNOWLEDGE = 1  # a = element kind, b = element index (for a phase request: its detail): the manager has the
    # report on this element. RESTART_HEARD is added to a if the report says only that a module was restarted
    CLEAR = 2  # a = element kind and place, b = element index: the operator clears the faults of the element
    WELCOME = 3  # a, b = upper and lower half of this command's number: the answer to the nonce of one PE
    RENEW = 4  # the PE is to send a fresh nonce: the manager cannot verify its states
    UNLOCK = 5  # a = seconds for which this one PE executes NMT commands and accepts SDO writes
    HOLDS = 6  # tells a standby manager a fact. a = element kind and place, b = element index: the fault of this
    # element is latched, or this is the phase. For a changed priority, a = PRIORITY and, in the high byte, the
    # function, and b = the priority (plus BY_OPERATOR). CLEAR with the same a: the priority is that of the spec again

    @property
    def is_known(self) -> bool:
        """Tell whether this version of the protocol has the operation; if not, a later minor may have it."""
        return self.name in Operation.__members__

    @classmethod
    def _missing_(cls, value: object) -> "Operation | None":
        """Return a number of one byte without a name here as an operation of a later minor."""
        if not isinstance(value, int) or not 0 <= value <= 0xFF:
            return None
        later = int.__new__(cls, value)
        later._name_, later._value_ = f"OPERATION_{value}", value
        return later


class ElementKind(IntEnum):
    """Kinds of elements in EMCY and CONTROL. The index of an element is its position among its kind in the spec.

    The index has another meaning in two cases:

    - A requested priority, in an EMCY: the high byte of the index is the function, the low byte the number of the
      request. The detail is the priority, or SPECS_PRIORITY.
    - A channel: the index is the position of its bus among the buses of the reporting PE. The detail of the EMCY is the
      number of the channel, from 1.

    In an EMCY, the kinds PHASE and PRIORITY occur only in requests.
    """

    PE = 0
    DEVICE = 1
    MODULE = 2
    BUS = 3
    PHASE = 4
    CHANNEL = 5
    PRIORITY = 6
    SCRIPT = 7  # in HOLDS alone, with index 0: a script of the operator is held
    SPEC = 9  # in HOLDS alone: the spec that flies, and b = its mark (`element_places`)


class FaultCode(IntEnum):
    """The CANopen emergency error codes that heronry uses (CiA 301: FF00h to FFFFh are device specific)."""

    RESET = 0x0000
    MODULE_EXCEPTION = 0xFF01
    MODULE_OVERRUN = 0xFF02
    REPORTED = 0xFF03  # a module reports that an element has failed
    PARTITION_ENDED = 0xFF04  # the process of a module ended while it ran
    MODULE_MISSING = 0xFF05  # the code of a module is not on this PE, or cannot be loaded there
    MODULE_RESTARTED = 0xFF08  # not yet a fault: a module has failed, and was restarted; the detail counts the restarts
    CHANNEL_LOST = 0xFF09  # not a fault of the PE: this PE hears nothing on a channel of a replicated bus
    CHANNEL_BACK = 0xFF0A  # the channel carries frames again
    DISAGREEMENT = 0xFF0B  # not a fault: two inputs of this module differ, and neither is known to be wrong
    UNKNOWN_ELEMENT = 0xFF0C  # not a fault: this module has reported an element that the spec does not have
    UNKNOWN_OUTPUT = 0xFF0D  # not a fault: this module gives a misspelt output, so an output of its mode is missing
    STALE = 0xFF0E  # not a fault by itself: an input of this module gets no data, or it gives no data (`silence`)
    UNKNOWN_INPUT = 0xFF0F  # not a fault: this module reads a misspelt input, which it can never get
    PHASE_REQUEST = 0xFF10  # not a fault: a module, or the `when` rule of a phase, requests a mission phase
    PRIORITY_REQUEST = 0xFF11  # not a fault: a module requests another priority of a function
    STATE_RESTORED = 0xFF12  # not a fault: this module has started from its checkpoint; the detail is its age in ms
    STATE_LACKING = 0xFF13  # not a fault: this module has started without a state, or has no checkpoint (`Lack`)


EVERYWHERE = 0  # in the place of CLEAR and HOLDS: the element as a whole

FORWARD_ONLY = 0x8000  # in the detail of a phase request: enter only a phase to which a rule leads from the present one
RESTART_HEARD = 0x100  # in a of ACKNOWLEDGE: the restart of a module is acknowledged, not its failure
REQUEST_NUMBERS = 0x8000  # in the detail of a phase request, the other bits number the requests of a PE, modulo this
PRIORITY_REQUEST_NUMBERS = 0x100  # the requests of a PE for the priority of one function are numbered modulo this
MOST_PRIORITY = 0x7FFF  # largest changed priority
MOST_FUNCTIONS = 0x100  # functions whose priority can be changed: the first ones of the spec
SPECS_PRIORITY = 0xFFFF  # in a request: the priority of the spec
BY_OPERATOR = 0x8000  # in b of HOLDS: the operator has set the priority


_STEPS = {step.value: step.name for step in Step}
_OPERATIONS = {operation.value: operation.name for operation in Operation}
_KINDS = {kind.value: kind.name for kind in ElementKind}

WELCOME_KIND = 7  # kind, in a TAG, of a CONTROL whose operation is WELCOME
NUMBER_SPAN = 1 << 13  # a TAG shows the number of its command modulo this
_TAGGED = {command.value: command.name for command in Command if command is not Command.TAG} | {WELCOME_KIND: "WELCOME"}

_TERM, _EPOCH, _DIGEST = Field("term", 16), Field("epoch", 16), Field("digest", 24)

LEASE = Layout("LEASE", _TERM, _EPOCH, Field("step", 8, _STEPS), _DIGEST)
ALIVE = Layout("ALIVE", _TERM, Field("sequence", 8), Field("spare", 6), Field("alive", len(PE_NODES)))
PREPARE = Layout("PREPARE", Field("term", 12), Field("contingency", 12), _EPOCH, _DIGEST)
SLICE_HEAD = Layout(
    "SLICE_HEAD", Field("node", 8), Field("epoch_low", 8), Field("index", 8), Field("length", 16), Field("digest", 24)
)
SLICE_BODY = Layout("SLICE_BODY", Field("node", 8), Field("epoch_low", 8), Field("index", 8), Field("body", 40))
ACTIVATE = Layout("ACTIVATE", _TERM, _EPOCH, Field("step", 8, _STEPS), _DIGEST)
PING = Layout("PING", _TERM, Field("node", 8), Field("sequence", 8))
CONTROL = Layout("CONTROL", _TERM, Field("node", 8), Field("operation", 8, _OPERATIONS), Field("a", 16), Field("b", 16))
TAG = Layout("TAG", Field("kind", 3, _TAGGED), Field("number", 13), Field("tag", 48))
# In CiA 301 the code is little-endian, so its two bytes are two fields here.
EMCY = Layout(
    "EMCY",
    Field("code_low", 8),
    Field("code_high", 8),
    Field("error_register", 8),
    Field("kind", 8, _KINDS),
    Field("index", 16),
    Field("detail", 16),
)


@dataclass(frozen=True, slots=True)
class Lease:
    """The active manager reports the activation step that `epoch` has reached (protocol rule 4).

    `digest`: the digest of the configuration of that epoch.
    """

    term: int
    epoch: int
    step: Step
    digest: int

    def encode(self) -> bytes:
        """Encode the payload of LEASE."""
        return LEASE.pack(self.term, self.epoch, self.step, self.digest)


@dataclass(frozen=True, slots=True)
class Alive:
    """The PEs that the manager counts as available, as node-IDs 92..125 (protocol rule 6)."""

    term: int
    sequence: int
    nodes: frozenset[int]

    def encode(self) -> bytes:
        """Encode the payload of ALIVE."""
        return ALIVE.pack(self.term, self.sequence, 0, sum(1 << (node - FIRST_PE) for node in self.nodes))


@dataclass(frozen=True, slots=True)
class Prepare:
    """Commands all PEs to stage the configuration with this digest.

    contingency: number of the configuration among the contingencies on board; 0: the slices follow in SLICE frames.
    """

    term: int
    epoch: int
    digest: int
    contingency: int = 0

    def encode(self) -> bytes:
        """Encode the payload of PREPARE."""
        return PREPARE.pack(self.term, self.contingency, self.epoch, self.digest)


@dataclass(frozen=True, slots=True)
class SliceHead:
    """Announces the slice of one PE, for the epoch being prepared: its length in bytes and its digest.

    epoch_low: the epoch modulo 256.
    """

    node: int
    epoch_low: int
    length: int
    digest: int

    def encode(self) -> bytes:
        """Encode the payload of SLICE with index 0."""
        return SLICE_HEAD.pack(self.node, self.epoch_low, 0, self.length, self.digest)


@dataclass(frozen=True, slots=True)
class SliceBody:
    """Up to five bytes of a slice, padded with zeros.

    `index` 1 has the first five bytes of the slice, `index` 2 the next five, and so on up to 255.
    """

    node: int
    epoch_low: int
    index: int
    body: bytes

    def encode(self) -> bytes:
        """Encode the payload of SLICE with index 1 or more."""
        if self.index == 0 or len(self.body) > SLICE_BYTES_PER_FRAME:
            raise ValueError(
                f"SLICE with index {self.index} and {len(self.body)} bytes cannot be encoded: "
                f"the index must be 1 or more, and the bytes at most {SLICE_BYTES_PER_FRAME}"
            )
        number = int.from_bytes(self.body.ljust(SLICE_BYTES_PER_FRAME, b"\0"), "big")
        return SLICE_BODY.pack(self.node, self.epoch_low, self.index, number)


@dataclass(frozen=True, slots=True)
class Activate:
    """Commands all PEs to activate the staged configuration, up to `step`."""

    term: int
    epoch: int
    step: Step
    digest: int

    def encode(self) -> bytes:
        """Encode the payload of ACTIVATE."""
        return ACTIVATE.pack(self.term, self.epoch, self.step, self.digest)


@dataclass(frozen=True, slots=True)
class Ping:
    """Commands a PE to send pages 0 and 1 of its state immediately; with `node` 0, commands all PEs."""

    term: int
    node: int
    sequence: int

    def encode(self) -> bytes:
        """Encode the payload of PING."""
        return PING.pack(self.term, self.node, self.sequence)


@dataclass(frozen=True, slots=True)
class Control:
    """Commands a PE to carry out an operation, whose arguments are `a` and `b`; with `node` 0, commands all PEs.

    An operation that is not known is one of a later minor of the protocol: a PE counts it, and forwards it.
    """

    term: int
    node: int
    operation: Operation
    a: int = 0
    b: int = 0

    def encode(self) -> bytes:
        """Encode the payload of CONTROL."""
        return CONTROL.pack(self.term, self.node, self.operation, self.a, self.b)


@dataclass(frozen=True, slots=True)
class Emergency:
    """The content of an EMCY: a fault, report or request (`code`), its element, and a detail.

    The detail, 0..65535, depends on the code (`FaultCode`, `ElementKind`). For the code REPORTED, the module that
    reports the fault has chosen the detail.
    """

    code: FaultCode
    error_register: int
    kind: ElementKind
    index: int
    detail: int

    @property
    def acknowledgement(self) -> tuple[int, int]:
        """Return the arguments `a` and `b` of the CONTROL that acknowledges this report."""
        restart = RESTART_HEARD if self.code is FaultCode.MODULE_RESTARTED else 0
        return self.kind | restart, self.detail if self.kind is ElementKind.PHASE else self.index

    def encode(self) -> bytes:
        """Encode the payload of EMCY."""
        return EMCY.pack(self.code & 0xFF, self.code >> 8, self.error_register, self.kind, self.index, self.detail)


ManagementMessage = Lease | Alive | Prepare | SliceHead | SliceBody | Activate | Ping | Control

COMMAND_OF: Mapping[type[ManagementMessage], Command] = {
    Lease: Command.LEASE,
    Alive: Command.ALIVE,
    Prepare: Command.PREPARE,
    SliceHead: Command.SLICE,
    SliceBody: Command.SLICE,
    Activate: Command.ACTIVATE,
    Ping: Command.PING,
    Control: Command.CONTROL,
}
"""For each message the command that determines its identifier."""


def is_newer(epoch: int, than: int) -> bool:
    """Tell whether an epoch is newer than another, modulo 2^16; NO_EPOCH is older than any epoch."""
    if NO_EPOCH in (epoch, than):
        return epoch != than and than == NO_EPOCH
    return 0 < (epoch - than) % 0x10000 < 0x8000


def newest_epoch(epochs: Iterable[int]) -> int:
    """Return the newest of some epochs, which must lie within 2^15 of one another; NO_EPOCH where `epochs` is empty."""
    newest = NO_EPOCH
    for epoch in epochs:
        newest = epoch if is_newer(epoch, newest) else newest
    return newest


def next_epoch(epoch: int) -> int:
    """Return the number of the next epoch after this one; it is never 0."""
    return epoch % 0xFFFF + 1


def decode_command(command: int, data: bytes) -> ManagementMessage | Malformed:
    """Decode the payload of a management frame.

    command: position of the frame's identifier among the ten identifiers of its manager (`identifiers.Command`).
    """
    decoder = _DECODERS.get(command)
    if decoder is None:
        return Malformed(f"management command {command} is not assigned")
    message = decoder(data)
    if not isinstance(message, SliceHead | SliceBody | Malformed) and not 0 < message.term <= MAX_TERM:
        return Malformed(f"term {message.term} is outside 1..{MAX_TERM}")
    return message


def _lease(data: bytes) -> Lease | Malformed:
    fields = LEASE.unpack(data)
    if fields is None or fields[2] not in _STEPS:
        return Malformed("LEASE has a wrong length or step")
    return Lease(fields[0], fields[1], Step(fields[2]), fields[3])


def _alive(data: bytes) -> Alive | Malformed:
    fields = ALIVE.unpack(data)
    if fields is None:
        return Malformed("ALIVE has a wrong length")
    term, sequence, _, bitmap = fields
    return Alive(term, sequence, frozenset(node for node in PE_NODES if bitmap >> node - FIRST_PE & 1))


def _prepare(data: bytes) -> Prepare | Malformed:
    fields = PREPARE.unpack(data)
    if fields is None:
        return Malformed("PREPARE has a wrong length")
    term, contingency, epoch, digest = fields
    return Prepare(term, epoch, digest, contingency)


def _slice(data: bytes) -> SliceHead | SliceBody | Malformed:
    head = SLICE_HEAD.unpack(data)
    if head is None:
        return Malformed("SLICE has a wrong length")
    if head[2] == 0:
        return SliceHead(head[0], head[1], head[3], head[4])
    return SliceBody(head[0], head[1], head[2], bytes(data[_BODY_FROM:_BODY_TO]))


def _activate(data: bytes) -> Activate | Malformed:
    fields = ACTIVATE.unpack(data)
    if fields is None or fields[2] not in _STEPS:
        return Malformed("ACTIVATE has a wrong length or step")
    return Activate(fields[0], fields[1], Step(fields[2]), fields[3])


def _ping(data: bytes) -> Ping | Malformed:
    fields = PING.unpack(data)
    return Malformed("PING has a wrong length") if fields is None else Ping(*fields)


def _control(data: bytes) -> Control | Malformed:
    fields = CONTROL.unpack(data)
    if fields is None:
        return Malformed("CONTROL has a wrong length")
    term, node, number, a, b = fields
    return Control(term, node, Operation(number), a, b)


_DECODERS = {
    Command.LEASE.value: _lease,
    Command.ALIVE.value: _alive,
    Command.PREPARE.value: _prepare,
    Command.SLICE.value: _slice,
    Command.ACTIVATE.value: _activate,
    Command.PING.value: _ping,
    Command.CONTROL.value: _control,
}


def is_welcome(control: bytes) -> bool:
    """Tell whether the payload of a CONTROL is that of a WELCOME."""
    return len(control) == CONTROL.length and control[_OPERATION_FROM] == Operation.WELCOME


def control_node(data: bytes) -> int:
    """Return the node-ID that a CONTROL addresses, from its payload, whose length must be right."""
    return data[_CONTROL_NODE_AT]


def slice_node(data: bytes) -> int:
    """Return the node-ID of the PE whose slice is in a SLICE, from the payload, which must have the right length."""
    return data[_NODE_AT]


def read_alive(data: bytes, node: int) -> tuple[int, bool] | None:
    """Return the term of an ALIVE, and whether it names `node` (92..125); None where `data` has a wrong length."""
    fields = ALIVE.unpack(data)
    return None if fields is None else (fields[0], bool(fields[3] >> node - FIRST_PE & 1))


def without_sequence(alive: bytes) -> bytes:
    """Return the payload of an ALIVE without the number that changes with every ALIVE."""
    return alive[:_SEQUENCE_FROM] + alive[_SEQUENCE_TO:]


def decode_tag(data: bytes) -> tuple[int, int, int] | None:
    """Return the three fields of a TAG: kind, number (its lowest 13 bits), tag; None if `data` has a wrong length."""
    fields = TAG.unpack(data)
    return None if fields is None else (fields[0], fields[1], fields[2])


def tag_kind(data: bytes) -> int | None:
    """Return the kind of command that a TAG is for, from its first byte; None where the TAG is empty."""
    return data[0] >> 8 - TAG.fields[0].bits if data else None


def decode_emergency(data: bytes) -> Emergency | Malformed:
    """Decode the payload of an EMCY; `Malformed` where the code or the element is not one of this project."""
    fields = EMCY.unpack(data)
    if fields is None:
        return Malformed("EMCY has a wrong length")
    low, high, register, kind, index, detail = fields
    try:
        return Emergency(FaultCode(high << 8 | low), register, ElementKind(kind), index, detail)
    except ValueError:
        return Malformed("EMCY has a code or element of another maker")


_CONTROL_NODE_AT, _ = CONTROL.span("node")
_NODE_AT, _ = SLICE_BODY.span("node")
_BODY_FROM, _BODY_TO = SLICE_BODY.span("body")
_OPERATION_FROM, _ = CONTROL.span("operation")
_SEQUENCE_FROM, _SEQUENCE_TO = ALIVE.span("sequence")
