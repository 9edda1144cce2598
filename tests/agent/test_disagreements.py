"""A module tells a disagreement: one EMCY a second, without a fault on record."""

from agent.one_pe import CONTROL, FLYING, NODE, OnePe, sent
from heronry_agent.module import DISAGREEMENT
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import FAULT_QUIET_NS


def test_it_goes_out_once_a_second_and_nobody_has_to_acknowledge_it() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.reports[CONTROL] = ((DISAGREEMENT, 140),)
    frames = sent(pe.pass_time(2 * FAULT_QUIET_NS + FAULT_QUIET_NS // 2), emcy_id(NODE))
    told = Emergency(FaultCode.DISAGREEMENT, 0, ElementKind.MODULE, CONTROL, 140).encode()
    assert [frame.data for frame in frames] == [told] * 3
    assert not pe.core.validate()
