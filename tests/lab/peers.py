"""The other nodes of a bus, played: a manager, as a PE receives it, and a PE, as a manager receives it.

These classes only make frames. The caller gives the frames to a receiver: a core that is stepped by hand, a simulated
bus, or an oracle.

    SteppedCore     a core, whose time passes by hand
    PlayedManager   makes commands, each with its TAG where there is a key, and answers nonces
    ProvenStates    adds tags to a PE's states, in the session that its manager has opened
    PlayedObjects   answers the requests of an SDO client, as the PEs that store the objects
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

from heronry_wire.authentication import NO_EMERGENCY, PAGE_1_BEAT, Key, Session
from heronry_wire.command_tags import CommandSigner
from heronry_wire.configuration_slice import Slice, slice_digest
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, management_id, state_id
from heronry_wire.management import (
    COMMAND_OF,
    SLICE_BYTES_PER_FRAME,
    Control,
    ManagementMessage,
    Operation,
    SliceBody,
    SliceHead,
)
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.sdo import (
    EXPEDITED,
    EXPEDITED_BYTES,
    LAST_SEGMENT,
    SEGMENT_BYTES,
    SEGMENT_UPLOAD,
    SIZE_GIVEN,
    TOGGLE,
    UPLOAD,
    UPLOAD_ANSWER,
    Abort,
    abort_message,
    command_of,
    read_head,
    segment,
    with_data,
    with_number,
)
from heronry_wire.state_frames import StatePage0, StatePage1, StatePage2, decode_state, joined_state, split_state

Event_contra = TypeVar("Event_contra", contravariant=True)
Action = TypeVar("Action")


def command_frame(message: ManagementMessage, manager: int = FIRST_MANAGER) -> Frame:
    """Return the frame of a command."""
    return Frame(management_id(manager, COMMAND_OF[type(message)]), message.encode())


def slice_messages(node: int, epoch: int, part: Slice | bytes, identity: bytes) -> list[SliceHead | SliceBody]:
    """Return head and bodies of a PE's slice; `identity` is that of the PE's table."""
    body = part if isinstance(part, bytes) else part.encode()
    head = SliceHead(node, epoch & 0xFF, len(body), slice_digest(identity, body))
    chunks = [body[at : at + SLICE_BYTES_PER_FRAME] for at in range(0, len(body), SLICE_BYTES_PER_FRAME)]
    return [head, *(SliceBody(node, epoch & 0xFF, number, chunk) for number, chunk in enumerate(chunks, start=1))]


class Core(Protocol[Event_contra, Action]):
    """The interface of every core."""

    def step(self, now_ns: int, event: Event_contra | Received | Tick) -> list[Action]:
        """Process an event; gives the actions."""

    def next_deadline_ns(self) -> int | None:
        """Return the latest time (ns) at which the core must be called again; None: no call is needed."""


class SteppedCore(Generic[Event_contra, Action]):
    """A core whose time passes by hand, deadline by deadline."""

    def __init__(self, core: Core[Event_contra, Action], now_ns: int) -> None:
        self.core, self.now_ns = core, now_ns

    def give(self, event: Event_contra | Received | Tick) -> list[Action]:
        """Process an event at the present time."""
        return self.core.step(self.now_ns, event)

    def hear(self, *frames: Frame, port: int = 0) -> list[Action]:
        """Receive frames."""
        return [action for frame in frames for action in self.give(Received(port, frame))]

    def pass_time(self, duration_ns: int, *, most_ticks: int = 1 << 20) -> list[Action]:
        """Let time pass; after `most_ticks` deadlines, later ones are left out."""
        end_ns, actions = self.now_ns + duration_ns, list[Action]()
        for _ in range(most_ticks):
            due_ns = self.core.next_deadline_ns()
            if due_ns is None or due_ns > end_ns:
                break
            self.now_ns = max(self.now_ns, due_ns)
            actions += self.give(Tick())
        self.now_ns = end_ns
        return actions

    def nonces(self, duration_ns: int, node: int) -> list[int]:
        """Let time pass; gives the nonces that a PE with a key sends in that time."""
        return nonces_in(self.pass_time(duration_ns), node)


def nonces_in(actions: Iterable[object], node: int) -> list[int]:
    """Return the nonces of a PE with a key among its actions."""
    sends = [action for action in actions if isinstance(action, Send)]
    pages = [decode_state(send.frame.data) for send in sends if send.frame.can_id == state_id(node)]
    return [page.nonce for page in pages if isinstance(page, StatePage2)]


class PlayedManager:
    """The frames of a manager."""

    def __init__(self, node: int = FIRST_MANAGER, term: int = 1, key: Key | None = None) -> None:
        """term: the term of sessions, used only with a key; a command has its own term."""
        self.node = node
        self.signer = None if key is None else CommandSigner(key, node, term)

    def frames(self, *messages: ManagementMessage) -> list[Frame]:
        """Return the frames of commands, each with its TAG where there is a key."""
        return [frame for message in messages for frame in self.tagged(command_frame(message, self.node))]

    def tagged(self, frame: Frame) -> list[Frame]:
        """Return a frame, and its TAG where there is a key and the term has a number left."""
        tag = None if self.signer is None else self.signer.tag(frame)
        return [frame] if tag is None else [frame, tag]

    def welcome(self, node: int, nonce: int) -> list[Frame]:
        """Answer the nonce of a PE; only a manager with a key can."""
        assert self.signer is not None
        return list(self.signer.welcome(node, nonce))

    @property
    def session(self) -> Session:
        """Return the session that the last WELCOME has opened."""
        assert self.signer is not None
        return Session(self.node, self.signer.term, self.signer.number)


@dataclass(slots=True)
class ProvenStates:
    """The states of a PE with a key."""

    node: int
    key: Key
    session: Session | None = None  # without one a state carries the tag 0
    beat: int = 0  # of the next page 0

    def prove(
        self, page: StatePage0 | StatePage1, emergency: bytes = NO_EMERGENCY, *, stride: int = 1, is_true: bool = True
    ) -> Frame:
        """Prove a state: a page 0, with the number of its beat, which also proves an EMCY; or a page 1.

        stride: from this beat to the next; above 1 as if frames were lost. is_true: False gives the tag 0.
        """
        beat, said_of_it = PAGE_1_BEAT, NO_EMERGENCY
        if isinstance(page, StatePage0):
            beat, said_of_it = self.beat, emergency
            self.beat += stride
            page = replace(page, sequence=beat % 256)
        said, digest = split_state(page.encode())
        tag = 0
        if self.session is not None and is_true:
            tag = self.key.state_tag(self.node, self.session, beat, said, digest, emergency=said_of_it)
        return Frame(state_id(self.node), joined_state(said, tag))

    def take(self, control: Control, manager: int) -> None:
        """Process a frame of this manager that opens or ends a session."""
        if control.node == self.node and control.operation is Operation.WELCOME:
            self.session, self.beat = Session(manager, control.term, control.a << 16 | control.b), 0
        elif control.node == self.node and control.operation is Operation.RENEW:
            self.session = None


class PlayedObjects:
    """The SDO servers of PEs: they answer with what `values` holds, by node, index and sub-index."""

    def __init__(self) -> None:
        self.values: dict[tuple[int, int, int], bytes] = {}
        self.asked: list[tuple[int, int, int]] = []
        self._rest = b""
        self._toggle = 0

    def answer(self, node: int, message: bytes) -> bytes:
        """Return the answer of a PE to a request; raises AssertionError where the client breaks CiA 301."""
        if command_of(message) == UPLOAD:
            index, sub_index, _ = read_head(message)
            self.asked.append((node, index, sub_index))
            value = self.values.get((node, index, sub_index))
            if value is None:
                return abort_message(index, sub_index, Abort.NO_DATA)
            if 0 < len(value) <= EXPEDITED_BYTES:
                command = UPLOAD_ANSWER | EXPEDITED | SIZE_GIVEN | EXPEDITED_BYTES - len(value) << 2
                return with_data(command, index, sub_index, value)
            self._rest, self._toggle = value, 0
            return with_number(UPLOAD_ANSWER | SIZE_GIVEN, index, sub_index, len(value))
        assert command_of(message) == SEGMENT_UPLOAD | self._toggle
        part, self._rest = self._rest[:SEGMENT_BYTES], self._rest[SEGMENT_BYTES:]
        answer = segment(self._toggle | SEGMENT_BYTES - len(part) << 1 | (0 if self._rest else LAST_SEGMENT), part)
        self._toggle ^= TOGGLE
        return answer
