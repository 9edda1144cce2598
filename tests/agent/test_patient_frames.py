"""Which frames nobody awaits: data that modules read, and output echoes; what they change waits for the next step."""

import pytest

from agent.one_pe import FLYING, MS, NEIGHBOUR, NODE, RATE_ID, OnePe, neighbour_state, rate_frame
from heronry_agent.core.modules import ECHO_NODES
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import actuator_echo_id, state_id
from heronry_wire.sansio import Received

ECHOES = ECHO_NODES.keys() - {actuator_echo_id(NODE)}  # of every actuator of another node


@pytest.fixture
def pe() -> OnePe:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.pass_time(5 * MS)
    return pe


def test_data_that_modules_read_and_echoes_are_patient_and_nothing_else_is(pe: OnePe) -> None:
    assert pe.core.patient_identifiers == {RATE_ID, *ECHOES}
    assert pe.core.patient_identifiers < set(pe.core.identifiers)
    pe.configure(Slice(()), 8)
    assert pe.core.patient_identifiers == ECHOES


def test_a_patient_frame_moves_no_deadline_and_is_read_by_the_next_step(pe: OnePe) -> None:
    due_ns = pe.core.next_deadline_ns()
    assert pe.give(Received(0, rate_frame(2.5))) == []
    assert pe.core.next_deadline_ns() == due_ns
    assert state_id(NEIGHBOUR) not in pe.core.patient_identifiers
    assert pe.give(Received(0, neighbour_state(7))) == []
