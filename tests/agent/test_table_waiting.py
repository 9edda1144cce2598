"""A PE that waits for its table: what it says and takes meanwhile."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.canopen_master import objects
from agent.one_pe import MS, NODE, TABLE, sent
from heronry_agent.table_waiting import WaitingCore
from heronry_agent.vocabulary import Action, Note
from heronry_wire.canopen_objects import OBJECTS
from heronry_wire.canopen_objects import TABLE as TABLE_INDEX
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.pe_table import TableError
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.sdo import Abort


class Waiting:
    """The core and its time."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.core = WaitingCore(NODE, 1_000_000, 0)

    def pass_time(self, duration_ns: int) -> list[Action]:
        end_ns, actions = self.now_ns + duration_ns, []
        while self.core.next_deadline_ns() <= end_ns:
            self.now_ns = max(self.now_ns, self.core.next_deadline_ns())
            actions += self.core.step(self.now_ns, Tick())
        self.now_ns = end_ns
        return actions

    def ask(self, message: bytes) -> tuple[list[bytes], list[str]]:
        """Answers to an SDO request, and notes."""
        actions = self.core.step(self.now_ns, Received(0, Frame(sdo_request_id(NODE), message)))
        notes = [action.text for action in actions if isinstance(action, Note)]
        return [frame.data for frame in sent(actions, sdo_response_id(NODE))], notes

    def give(self, text: bytes) -> tuple[Abort | None, list[str]]:
        """Write a table by segments: why it is refused, and what is noted."""
        self.ask(b"\x21" + TABLE_INDEX.to_bytes(2, "little") + b"\0" + len(text).to_bytes(4, "little"))
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
    refusal, notes = waiting.give(TABLE.to_json().encode() + b"\n")
    assert refusal is None
    assert notes == ["PE tail of small"]
    assert waiting.core.table == TABLE


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (replace(TABLE, node_id=NODE + 1).to_json().encode(), "it is for node 94"),
        (b"{}", "not of format 1"),
        (b"not a table", "is not JSON"),
        (b"\xff\xfe", "decode"),
        (json.dumps({**json.loads(TABLE.to_json()), "uplink": 7}).encode(), "uplink 7 names no port"),
        (json.dumps({**json.loads(TABLE.to_json()), "variables": {}}).encode(), "variable"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_its_reason(text: bytes, says: str) -> None:
    waiting = Waiting()
    refusal, (note,) = waiting.give(text)
    assert refusal is Abort.VALUE
    assert says in note
    assert waiting.core.table is None
    assert waiting.give(TABLE.to_json().encode())[0] is None


def test_who_is_no_pe_cannot_wait() -> None:
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
