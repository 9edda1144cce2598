"""The management protocol: every message between a manager and the PEs, and its bytes.

Who says what
    The manager (126 or 127) sends LEASE and ALIVE every heartbeat period, PREPARE, SLICE and ACTIVATE when it
    reconfigures, PING when it suspects, CONTROL to acknowledge. A PE sends STATE every heartbeat period (page 0; page 1
    on change and every tenth time) and EMCY for a fault. Nothing else commands or reports.

Two phases, numbered
    PREPARE names a new epoch and the digest of the whole configuration, and the number of a contingency if it is one:
    a PE that has that on board stages it. For each other PE, SLICE with index 0 gives
    length and digest of its slice; a PE whose running slice has that digest stages it at once, any other collects the
    body from the frames 1, 2, ... (five bytes each) in any order, doubled or not. What is staged is told in page 1.
    ACTIVATE then carries a step, and LEASE repeats it for whoever missed it:

    step BREAK   stop what the new slice lacks, rewire what stays, send nothing new, report BROKEN
    step GO      start the rest, but for DEMUX branches that are new on this PE: those stay held (PARTIAL)
    step GO_ALL  start those too (ACTIVE)

    A step contains the steps before it, so one ACTIVATE with GO_ALL is enough where nothing exclusive moves. Every
    command may be lost, late or doubled: it names the epoch, an older epoch or a lower term changes nothing, and a step
    already taken is not taken again.

Numbers
    An epoch is compared modulo 2^16 (`is_newer`), 0 is "none". A term is 1..4095 (PREPARE has no room for more) and
    only rises; one outside is malformed. A digest is 24 bits. All numbers are big-endian, but for EMCY, whose head is
    CiA 301's and little-endian.

Malformed bytes decode to `Malformed` with a reason; encoding a number that does not fit raises ValueError.

Source: docs/protocol.md, rules 1 to 8; CiA 301 7.2.7 (EMCY), 7.2.8.3.2 (heartbeat).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from heronry_wire.frame import Malformed
from heronry_wire.identifiers import Command
from heronry_wire.layout import Field, Layout

MAX_TERM = 0xFFF
NO_EPOCH = 0
SLICE_BYTES_PER_FRAME = 5


class Step(IntEnum):
    """How far an epoch has got; each contains those before it."""

    PREPARED = 0
    BREAK = 1
    GO = 2
    GO_ALL = 3


class PeState(IntEnum):
    """What a PE does with the epoch that its state names."""

    UNCONFIGURED = 0
    BROKEN = 1
    PARTIAL = 2
    ACTIVE = 3


class PeFlags(IntFlag):
    """What else a PE says in every state frame."""

    HEARS_LEASE = 1
    FAULT_PENDING = 2
    OUTPUT_HELD = 4


class Reason(IntEnum):
    """Why a PE has not staged, or what it last refused."""

    NONE = 0
    INCOMPLETE = 1  # frames of the slice are missing: send it again
    DIGEST = 2  # the bytes do not have the digest announced, or the table is another spec's
    UNKNOWN_INDEX = 3  # the slice names what the table does not have
    IMAGE = 4  # an image cannot be loaded here
    STALE_TERM = 5  # a higher term has been heard
    STALE_EPOCH = 6  # this epoch, or a newer one, has been staged or abandoned before
    NOT_ON_BOARD = 7  # the table has no such contingency under this number: send the slice


class Operation(IntEnum):
    """Operations of CONTROL."""

    ACKNOWLEDGE = 1  # a = element kind, b = element index (of a phase: the request's detail): it has been heard. Where
    # all that was heard is that the module was built anew, RESTART_HEARD is added to a
    CLEAR = 2  # a = element kind, b = element index: the operator takes the element for well again
    WELCOME = 3  # a, b = upper and lower half of the command's own number: the answer to the nonce of one PE
    RENEW = 4  # send a fresh nonce: the states of this PE cannot be believed as they are
    UNLOCK = 5  # a = seconds for which NMT and SDO may write on this one PE
    HOLDS = 6  # a = element kind, b = element index: it is latched; of a phase, it is the present one. For a standby


class ElementKind(IntEnum):
    """Kinds of elements in EMCY and CONTROL; the index counts in the spec's order.

    A phase is only asked for. Of a channel the index is that of the bus among those of the PE that tells, and the
    detail of the EMCY is the channel's number, from 1.
    """

    PE = 0
    DEVICE = 1
    MODULE = 2
    BUS = 3
    PHASE = 4
    CHANNEL = 5


class FaultCode(IntEnum):
    """CANopen emergency error codes used here (CiA 301: FF00h to FFFFh are device specific)."""

    RESET = 0x0000
    MODULE_EXCEPTION = 0xFF01
    MODULE_OVERRUN = 0xFF02
    REPORTED = 0xFF03  # a module says that an element has failed
    PARTITION_ENDED = 0xFF04  # the process of a module ended under it
    MODULE_RESTARTED = 0xFF08  # no fault yet: a module has failed, and was built anew; the detail counts
    CHANNEL_LOST = 0xFF09  # no fault of this PE: a channel of a replicated bus carries nothing here
    CHANNEL_BACK = 0xFF0A  # it does again
    PHASE_REQUEST = 0xFF10  # no fault: a module, or a phase's own rule, asks for a mission phase


FORWARD_ONLY = 0x8000  # in the detail of a phase request: enter no phase that comes before the present one in the spec
RESTART_HEARD = 0x100  # in a of ACKNOWLEDGE: the module was built anew; that it has failed for good was not heard
REQUEST_NUMBERS = 0x8000  # the rest of it counts the requests of a PE, modulo this


_STEPS = {step.value: step.name for step in Step}
_PE_STATES = tuple(PeState)
_PE_FLAGS = tuple(map(PeFlags, range(8)))
_STATES = {state.value: state.name for state in PeState}
_REASONS = {reason.value: reason.name for reason in Reason}
_OPERATIONS = {operation.value: operation.name for operation in Operation}
_KINDS = {kind.value: kind.name for kind in ElementKind}

WELCOME_KIND = 7  # of a TAG: a CONTROL whose operation is WELCOME
NUMBER_SPAN = 1 << 13  # a TAG shows the number of its command modulo this
_TAGGED = {command.value: command.name for command in Command if command is not Command.TAG} | {WELCOME_KIND: "WELCOME"}

_TERM, _EPOCH, _DIGEST = Field("term", 16), Field("epoch", 16), Field("digest", 24)
_STATE_HEAD = (Field("page", 2), Field("state", 3, _STATES), Field("flags", 3))

LEASE = Layout("LEASE", _TERM, _EPOCH, Field("step", 8, _STEPS), _DIGEST)
ALIVE = Layout("ALIVE", _TERM, Field("sequence", 8), Field("spare", 6), Field("alive", 34))
PREPARE = Layout("PREPARE", Field("term", 12), Field("contingency", 12), _EPOCH, _DIGEST)
SLICE_HEAD = Layout(
    "SLICE_HEAD", Field("node", 8), Field("epoch_low", 8), Field("index", 8), Field("length", 16), Field("digest", 24)
)
SLICE_BODY = Layout("SLICE_BODY", Field("node", 8), Field("epoch_low", 8), Field("index", 8), Field("body", 40))
ACTIVATE = Layout("ACTIVATE", _TERM, _EPOCH, Field("step", 8, _STEPS), _DIGEST)
PING = Layout("PING", _TERM, Field("node", 8), Field("sequence", 8))
CONTROL = Layout("CONTROL", _TERM, Field("node", 8), Field("operation", 8, _OPERATIONS), Field("a", 16), Field("b", 16))
TAG = Layout("TAG", Field("kind", 3, _TAGGED), Field("number", 13), Field("tag", 48))
STATE_0 = Layout("STATE_0", *_STATE_HEAD, Field("incarnation", 8), _EPOCH, Field("sequence", 8), _DIGEST)
STATE_1 = Layout(
    "STATE_1",
    *_STATE_HEAD,
    Field("staged_epoch", 16),
    Field("staged_digest", 24),
    Field("reason", 8, _REASONS),
    Field("load", 8, unit="%"),
)
STATE_2 = Layout("STATE_2", *_STATE_HEAD, Field("nonce", 56))
STATE_3 = Layout("STATE_3", *_STATE_HEAD, Field("runs_digest", 24), Field("unproven", 16), Field("other", 16))
# CiA 301 has the code little-endian; here its two bytes are two fields.
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
    """The manager reigns: `epoch` with `digest` stands at `step` (rule 4)."""

    term: int
    epoch: int
    step: Step
    digest: int

    def encode(self) -> bytes:
        """Payload of LEASE."""
        return LEASE.pack(self.term, self.epoch, self.step, self.digest)


@dataclass(frozen=True, slots=True)
class Alive:
    """The PEs that the manager counts on, as node-IDs 92..125 (rule 6)."""

    term: int
    sequence: int
    nodes: frozenset[int]

    def encode(self) -> bytes:
        """Payload of ALIVE."""
        return ALIVE.pack(self.term, self.sequence, 0, sum(1 << (node - 92) for node in self.nodes))


@dataclass(frozen=True, slots=True)
class Prepare:
    """A configuration is about to be staged: contingency number such and such; with 0 the slices follow."""

    term: int
    epoch: int
    digest: int
    contingency: int = 0

    def encode(self) -> bytes:
        """Payload of PREPARE."""
        return PREPARE.pack(self.term, self.contingency, self.epoch, self.digest)


@dataclass(frozen=True, slots=True)
class SliceHead:
    """Length in bytes and digest of the slice of one PE in the epoch being prepared."""

    node: int
    epoch_low: int
    length: int
    digest: int

    def encode(self) -> bytes:
        """Payload of SLICE with index 0."""
        return SLICE_HEAD.pack(self.node, self.epoch_low, 0, self.length, self.digest)


@dataclass(frozen=True, slots=True)
class SliceBody:
    """Five bytes of a slice: those from 5 (index - 1) on, filled up with zeros. Index 1..255."""

    node: int
    epoch_low: int
    index: int
    body: bytes

    def encode(self) -> bytes:
        """Payload of SLICE with index 1 or more."""
        if self.index == 0 or len(self.body) > SLICE_BYTES_PER_FRAME:
            raise ValueError(f"SLICE {self.index} has {len(self.body)} bytes; send 5 at a time, from index 1 on")
        number = int.from_bytes(self.body.ljust(SLICE_BYTES_PER_FRAME, b"\0"), "big")
        return SLICE_BODY.pack(self.node, self.epoch_low, self.index, number)


@dataclass(frozen=True, slots=True)
class Activate:
    """Take the staged configuration into use, up to `step`."""

    term: int
    epoch: int
    step: Step
    digest: int

    def encode(self) -> bytes:
        """Payload of ACTIVATE."""
        return ACTIVATE.pack(self.term, self.epoch, self.step, self.digest)


@dataclass(frozen=True, slots=True)
class Ping:
    """Say your state now; node 0 asks everybody."""

    term: int
    node: int
    sequence: int

    def encode(self) -> bytes:
        """Payload of PING."""
        return PING.pack(self.term, self.node, self.sequence)


@dataclass(frozen=True, slots=True)
class Control:
    """An operation on one PE, or on all with node 0."""

    term: int
    node: int
    operation: Operation
    a: int = 0
    b: int = 0

    def encode(self) -> bytes:
        """Payload of CONTROL."""
        return CONTROL.pack(self.term, self.node, self.operation, self.a, self.b)


@dataclass(frozen=True, slots=True)
class StatePage0:
    """What a PE runs now."""

    state: PeState
    flags: PeFlags
    incarnation: int
    epoch: int
    sequence: int
    digest: int

    def encode(self) -> bytes:
        """Payload of a state frame, page 0."""
        return STATE_0.pack(0, self.state, self.flags, self.incarnation, self.epoch, self.sequence, self.digest)


@dataclass(frozen=True, slots=True)
class StatePage1:
    """The epoch last asked for, what is staged of it (digest 0: not yet) or why not, and the CPU load in per cent."""

    state: PeState
    flags: PeFlags
    staged_epoch: int
    staged_digest: int
    reason: Reason
    load: int

    def encode(self) -> bytes:
        """Payload of a state frame, page 1."""
        return STATE_1.pack(
            1, self.state, self.flags, self.staged_epoch, self.staged_digest, self.reason, min(self.load, 255)
        )


@dataclass(frozen=True, slots=True)
class StatePage2:
    """A PE with a key asks for a fresh start: who holds the key answers its nonce with WELCOME (rule 11)."""

    state: PeState
    flags: PeFlags
    nonce: int

    def encode(self) -> bytes:
        """Payload of a state frame, page 2."""
        return STATE_2.pack(2, self.state, self.flags, self.nonce)


@dataclass(frozen=True, slots=True)
class StatePage3:
    """With a key: the digest of what runs, and how many commands were refused, modulo 2^16: no tag fitted, all else."""

    state: PeState
    flags: PeFlags
    digest: int
    unproven: int
    other: int

    def encode(self) -> bytes:
        """Payload of a state frame, page 3."""
        return STATE_3.pack(3, self.state, self.flags, self.digest, self.unproven, self.other)


StatePage = StatePage0 | StatePage1 | StatePage2 | StatePage3


@dataclass(frozen=True, slots=True)
class Emergency:
    """A fault: which element, and a detail (0..65535) that its finder chose."""

    code: FaultCode
    error_register: int
    kind: ElementKind
    index: int
    detail: int

    @property
    def acknowledgement(self) -> tuple[int, int]:
        """Give a and b of the ACKNOWLEDGE that answers just this, so that nothing else is taken for heard."""
        restart = RESTART_HEARD if self.code is FaultCode.MODULE_RESTARTED else 0
        return self.kind | restart, self.detail if self.kind is ElementKind.PHASE else self.index

    def encode(self) -> bytes:
        """Payload of EMCY."""
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
"""Under which of its manager's identifiers a message goes out."""


def is_newer(epoch: int, than: int) -> bool:
    """Tell whether an epoch is newer than another, modulo 2^16; any is newer than none, and none than nothing."""
    if NO_EPOCH in (epoch, than):
        return epoch != than and than == NO_EPOCH
    return 0 < (epoch - than) % 0x10000 < 0x8000


def newest_epoch(epochs: Iterable[int]) -> int:
    """Newest of some epochs that lie close together; none of none."""
    newest = NO_EPOCH
    for epoch in epochs:
        newest = epoch if is_newer(epoch, newest) else newest
    return newest


def next_epoch(epoch: int) -> int:
    """Epoch after this one; never 0."""
    return epoch % 0xFFFF + 1


def decode_command(command: int, data: bytes) -> ManagementMessage | Malformed:
    """Decode a management frame by its place among the ten identifiers of its manager (`identifiers.Command`)."""
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
    return Alive(term, sequence, frozenset(92 + bit for bit in range(34) if bitmap >> bit & 1))


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
    return SliceBody(head[0], head[1], head[2], bytes(data[3:]))


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
    if fields is None or fields[2] not in _OPERATIONS:
        return Malformed("CONTROL has a wrong length or operation")
    return Control(fields[0], fields[1], Operation(fields[2]), fields[3], fields[4])


_DECODERS = {
    Command.LEASE.value: _lease,
    Command.ALIVE.value: _alive,
    Command.PREPARE.value: _prepare,
    Command.SLICE.value: _slice,
    Command.ACTIVATE.value: _activate,
    Command.PING.value: _ping,
    Command.CONTROL.value: _control,
}


def decode_state(data: bytes) -> StatePage | Malformed:
    """Decode a state frame, any page."""
    if len(data) != STATE_0.length or _state_of(data) not in _STATES:
        return Malformed("STATE has a wrong length or state")
    return _PAGES[data[0] >> 6](_PE_STATES[_state_of(data)], _PE_FLAGS[data[0] & 7], data)


def _state_of(data: bytes) -> int:
    return data[0] >> 3 & 7


def _page_0(state: PeState, flags: PeFlags, data: bytes) -> StatePage0:
    return StatePage0(state, flags, *STATE_0.fields_of(data)[3:])


def _page_1(state: PeState, flags: PeFlags, data: bytes) -> StatePage1 | Malformed:
    staged_epoch, staged_digest, reason, load = STATE_1.fields_of(data)[3:]
    if reason not in _REASONS:
        return Malformed("STATE page 1 has an unknown reason")
    return StatePage1(state, flags, staged_epoch, staged_digest, Reason(reason), load)


def _page_2(state: PeState, flags: PeFlags, data: bytes) -> StatePage2:
    return StatePage2(state, flags, int.from_bytes(data[1:], "big"))


def _page_3(state: PeState, flags: PeFlags, data: bytes) -> StatePage3:
    return StatePage3(state, flags, *STATE_3.fields_of(data)[3:])


_PAGES: tuple[Callable[[PeState, PeFlags, bytes], StatePage | Malformed], ...] = (_page_0, _page_1, _page_2, _page_3)


def is_welcome(control: bytes) -> bool:
    """Tell whether the payload of a CONTROL is that of a WELCOME."""
    return len(control) == CONTROL.length and control[3] == Operation.WELCOME


def decode_emergency(data: bytes) -> Emergency | Malformed:
    """Decode an EMCY frame; another maker's codes are malformed here, and only counted."""
    fields = EMCY.unpack(data)
    if fields is None:
        return Malformed("EMCY has a wrong length")
    low, high, register, kind, index, detail = fields
    try:
        return Emergency(FaultCode(high << 8 | low), register, ElementKind(kind), index, detail)
    except ValueError:
        return Malformed("EMCY has a code or element that is not ours")
