"""A PE that has a table is given another one over the bus."""

from dataclasses import replace

from agent.one_pe import FLYING, MS, NODE, TABLE, OnePe, sent
from heronry_wire.canopen_objects import TABLE as TABLE_INDEX
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.sdo import Abort

OTHER = replace(TABLE, spec="another")
TEXT = OTHER.to_json().encode()


def ask(pe: OnePe, message: bytes) -> bytes:
    actions = pe.hear(Frame(sdo_request_id(NODE), message)) + pe.pass_time(5 * MS)
    (answer,) = sent(actions, sdo_response_id(NODE))
    return answer.data


def begin(pe: OnePe, text: bytes = TEXT) -> bytes:
    head = b"\x21" + TABLE_INDEX.to_bytes(2, "little") + b"\0"
    return ask(pe, head + len(text).to_bytes(4, "little"))


def write(pe: OnePe, text: bytes = TEXT) -> bytes:
    """Write a table by segments; gives the last answer."""
    answer, toggle = b"", 0
    for at in range(0, len(text), 7):
        part, is_last = text[at : at + 7], at + 7 >= len(text)
        answer = ask(pe, bytes((toggle | 7 - len(part) << 1 | is_last,)) + part.ljust(7, b"\0"))
        toggle ^= 0x10
    return answer


def is_refused(answer: bytes) -> bool:
    return answer[0] == 0x80 and answer[4:] == Abort.DEVICE_STATE.value.to_bytes(4, "little")


def test_a_pe_that_runs_nothing_takes_another_table_where_its_agent_may() -> None:
    for may in (True, False):
        pe = OnePe(takes_tables=may)
        assert not is_refused(begin(pe))
        assert is_refused(write(pe)) is not may
        assert (pe.core.new_table == OTHER) is may


def test_a_pe_that_runs_takes_none_in_place_of_its_own() -> None:
    pe = OnePe(takes_tables=True)
    assert not is_refused(begin(pe))
    pe.configure(FLYING, 5)
    pe.pass_time(1 * MS)
    assert not is_refused(write(pe))  # it is beside now
    assert pe.core.new_table is None
    pe = OnePe()
    pe.configure(FLYING, 5)
    assert is_refused(begin(pe))
