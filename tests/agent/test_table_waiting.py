"""A PE that waits for its table: what it sends and accepts meanwhile."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.canopen_master import objects
from agent.one_pe import MANAGER, MS, NODE, TABLE, Message, sent
from heronry_agent.core.authority import Secret
from heronry_agent.core.authority.authenticity import LONGEST_UNLOCK_S
from heronry_agent.core.vocabulary import Action, Note
from heronry_agent.shell.table_waiting import WaitingCore
from heronry_wire.authentication import SEAL_BYTES, Key
from heronry_wire.canopen_objects import CHALLENGE, OBJECTS
from heronry_wire.canopen_objects import TABLE as TABLE_INDEX
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.management import Alive, Control, Lease, Operation, SliceHead, Step
from heronry_wire.pe_table import TableError
from heronry_wire.sansio import Received, Send
from heronry_wire.sdo import Abort
from heronry_wire.state_frames import PeState, StatePage2, StatePage3, decode_state
from lab.peers import PlayedManager, SteppedCore, command_frame


class Waiting(SteppedCore):
    """The core and its time."""

    def __init__(self, secret: Secret | None = None) -> None:
        self.core: WaitingCore
        super().__init__(WaitingCore(NODE, 1_000_000, 0, secret), 0)

    def ask(self, message: bytes) -> tuple[list[bytes], list[str]]:
        """Answers to an SDO request, and notes."""
        actions = self.hear(Frame(sdo_request_id(NODE), message))
        notes = [action.text for action in actions if isinstance(action, Note)]
        return [frame.data for frame in sent(actions, sdo_response_id(NODE))], notes

    def write(self, text: bytes) -> tuple[Abort | None, list[str]]:
        """Write a table by segments; gives why it is refused, and the notes."""
        (answer,), notes = self.ask(
            b"\x21" + TABLE_INDEX.to_bytes(2, "little") + b"\0" + len(text).to_bytes(4, "little")
        )
        if answer[0] == 0x80:
            return Abort(int.from_bytes(answer[4:], "little")), notes
        toggle = 0
        for at in range(0, len(text), 7):
            part, is_last = text[at : at + 7], at + 7 >= len(text)
            (answer,), notes = self.ask(bytes((toggle | 7 - len(part) << 1 | is_last,)) + part.ljust(7, b"\0"))
            toggle ^= 0x10
            if answer[0] == 0x80:
                return Abort(int.from_bytes(answer[4:], "little")), notes
        return None, notes


def test_it_is_a_node_and_to_a_manager_it_is_down() -> None:
    waiting = Waiting()
    actions = waiting.pass_time(2_500 * MS)
    assert [frame.data for frame in sent(actions, heartbeat_id(NODE))] == [b"\x00", b"\x7f", b"\x7f"]
    assert sent(actions, state_id(NODE)) == []
    assert len(actions) == 3
    for index in objects():
        answers, _ = waiting.ask(b"\x40" + index.to_bytes(2, "little") + b"\0\0\0\0\0")
        assert answers
        assert answers[0][0] != 0x80
    assert len(OBJECTS) == len(objects())


def test_it_takes_its_table() -> None:
    waiting = Waiting()
    refusal, notes = waiting.write(TABLE.to_json().encode() + b"\n")
    assert refusal is None
    assert notes == ["PE tail of small"]
    assert waiting.core.table == TABLE


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (replace(TABLE, node_id=NODE + 1).to_json().encode(), "it is for node 94"),
        (b"{}", "names no version of the protocol"),
        (b"not a table", "is not JSON"),
        (b"\xff\xfe", "decode"),
        (json.dumps({**json.loads(TABLE.to_json()), "uplink": 7}).encode(), "is damaged"),
        (replace(TABLE, uplink=7).to_json().encode(), "uplink 7 names no port"),
        (replace(TABLE, variables={}).to_json().encode(), "variable"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_its_reason(text: bytes, says: str) -> None:
    waiting = Waiting()
    refusal, (note,) = waiting.write(text)
    assert refusal is Abort.VALUE
    assert says in note
    assert waiting.core.table is None
    assert waiting.write(TABLE.to_json().encode())[0] is None


def test_a_node_that_is_no_pe_cannot_wait() -> None:
    with pytest.raises(TableError, match="PEs have 92 to 125"):
        WaitingCore(91, 1_000_000, 0)


@given(st.lists(st.tuples(st.sampled_from([0, 128, sdo_request_id(NODE), 300]), st.binary(max_size=8), st.booleans())))
def test_whatever_comes_it_waits_on(story: list[tuple[int, bytes, bool]]) -> None:
    waiting = Waiting()
    for identifier, data, extended in story:
        frame = Frame(identifier, data, extended)
        actions = waiting.core.step(waiting.now_ns, Received(0, frame))
        assert all(isinstance(action, Send | Note) for action in actions)
        waiting.pass_time(1 * MS)
    assert waiting.core.table is None


# With a key

KEY, FOREIGN = Key(b"k" * 32), Key(b"f" * 32)
TEXT = TABLE.to_json().encode()
STOP = Frame(0, bytes((2, NODE)))


class KeyedWaiting(Waiting):
    """A node with a key that waits, and a manager that has it too."""

    def __init__(self, salt: bytes = b"salt") -> None:
        super().__init__(Secret(KEY, salt))
        self.manager = PlayedManager(MANAGER, 3, KEY)

    def challenge(self) -> int:
        (answer,), _ = self.ask(b"\x40" + CHALLENGE.to_bytes(2, "little") + bytes(5))
        return int.from_bytes(answer[4:], "little")

    def sealed(self) -> bytes:
        return KEY.sealed(TEXT, self.challenge())

    def tell(self, *messages: Message) -> list[Action]:
        """Send commands, each with its TAG."""
        return self.hear(*self.manager.frames(*messages))

    def pages(self, actions: list[Action]) -> list[object]:
        return [decode_state(frame.data) for frame in sent(actions, state_id(NODE))]

    def meet(self) -> None:
        """Let the node send its nonce, and answer with WELCOME."""
        (page,) = self.pages(self.tell(Lease(3, 0, Step.PREPARED, 0)))
        assert isinstance(page, StatePage2)
        (said,) = self.pages(self.hear(*self.manager.welcome(NODE, page.nonce)))
        assert isinstance(said, StatePage3)
        assert said.state is PeState.UNCONFIGURED


@pytest.fixture
def keyed() -> KeyedWaiting:
    """Return a node that accepts the commands of its manager."""
    waiting = KeyedWaiting()
    waiting.meet()
    return waiting


def test_with_a_key_it_is_silent_until_a_manager_speaks_and_then_asks() -> None:
    waiting = KeyedWaiting()
    assert sent(waiting.pass_time(3_000 * MS), state_id(NODE)) == []
    waiting.meet()


def test_it_takes_its_table_sealed_and_unlocked_and_in_no_other_way(keyed: KeyedWaiting) -> None:
    sealed = keyed.sealed()
    assert keyed.write(sealed) == (Abort.DEVICE_STATE, [])
    keyed.tell(Control(3, NODE, Operation.UNLOCK, 30))
    foreign, old = FOREIGN.sealed(TEXT, keyed.challenge()), KEY.sealed(TEXT, 0)
    for not_sealed in (TEXT, foreign, old, sealed[:-1], TEXT[:SEAL_BYTES], sealed.replace(b"small", b"large")):
        refusal, (note,) = keyed.write(not_sealed)
        assert refusal is Abort.VALUE
        assert "no seal of this fleet's key" in note
    assert keyed.core.table is None
    assert keyed.write(sealed) == (None, ["PE tail of small"])
    assert keyed.core.table == TABLE


def test_a_table_recorded_before_a_start_is_refused_after_it(keyed: KeyedWaiting) -> None:
    recorded, again = keyed.sealed(), KeyedWaiting(b"another salt")
    again.meet()
    again.tell(Control(3, NODE, Operation.UNLOCK, 30))
    assert again.write(recorded)[0] is Abort.VALUE
    assert again.write(again.sealed())[0] is None
    assert KeyedWaiting().sealed() == recorded  # the salt alone tells two starts apart
    assert Waiting().ask(b"\x40" + CHALLENGE.to_bytes(2, "little") + bytes(5))[0][0][4:] == bytes(4)


def test_it_is_locked_again_when_the_time_is_up(keyed: KeyedWaiting) -> None:
    keyed.tell(Control(3, NODE, Operation.UNLOCK, 9_999))
    keyed.pass_time((LONGEST_UNLOCK_S * 1_000 + 1) * MS)
    assert keyed.write(keyed.sealed())[0] is Abort.DEVICE_STATE


@pytest.mark.parametrize(
    "message",
    [
        Control(3, NODE + 1, Operation.UNLOCK, 30),
        Control(2, NODE, Operation.UNLOCK, 30),
        Control(3, NODE, Operation.RENEW, 30),
        Alive(3, 1, frozenset({NODE})),
        SliceHead(NODE, 1, 5, 7),
    ],
)
def test_nothing_else_that_a_manager_says_unlocks_it(keyed: KeyedWaiting, message: Message) -> None:
    keyed.tell(Lease(3, 0, Step.PREPARED, 0))
    keyed.tell(message)
    assert keyed.write(keyed.sealed())[0] is Abort.DEVICE_STATE


def test_an_unlock_without_its_tag_does_nothing(keyed: KeyedWaiting) -> None:
    keyed.hear(command_frame(Control(3, NODE, Operation.UNLOCK, 30)))
    assert keyed.write(keyed.sealed())[0] is Abort.DEVICE_STATE


def test_nmt_waits_for_the_lock_too(keyed: KeyedWaiting) -> None:
    keyed.hear(STOP)
    assert keyed.write(keyed.sealed())[0] is Abort.DEVICE_STATE  # it answers: it was not stopped
    keyed.tell(Control(3, NODE, Operation.UNLOCK, 30))
    keyed.hear(STOP)
    assert keyed.ask(b"\x40\x00\x10\0\0\0\0\0") == ([], [])
