"""What a PE tells of a channel that carries nothing: at once, every second, and that it is back; and nothing else."""

from dataclasses import replace

import pytest

from agent.one_pe import BEAT_NS, FLYING, GATEWAY_TABLE, MS, NODE, TABLE, OnePe, pages, sent
from heronry_agent.core.vocabulary import Action, ChannelsLost, Note
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode, decode_emergency
from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import CHANNEL_REPORT_NS

NONE: frozenset[int] = frozenset()


def twin(table: PeTable) -> PeTable:
    return replace(table, ports=tuple(replace(port, channels=2) for port in table.ports))


@pytest.fixture
def pe() -> OnePe:
    flying = OnePe(twin(TABLE))
    flying.configure(FLYING, 7)
    flying.pass_time(5 * BEAT_NS)
    return flying


def told(actions: list[Action]) -> list[tuple[FaultCode, int, int]]:
    """Reports on the uplink: code, port, channel."""
    heard = [decode_emergency(frame.data) for frame in sent(actions, emcy_id(NODE), 0)]
    reports = [e for e in heard if isinstance(e, Emergency) and e.kind is ElementKind.CHANNEL]
    assert len(reports) == len(sent(actions, emcy_id(NODE)))
    return [(e.code, e.index, e.detail) for e in reports]


def test_a_lost_channel_is_told_at_once_and_every_second_and_its_return_once(pe: OnePe) -> None:
    assert told(pe.give(ChannelsLost(0, frozenset({2})))) == [(FaultCode.CHANNEL_LOST, 0, 2)]
    assert told(pe.pass_time(3 * CHANNEL_REPORT_NS)) == [(FaultCode.CHANNEL_LOST, 0, 2)] * 3
    assert told(pe.give(ChannelsLost(0, NONE))) == [(FaultCode.CHANNEL_BACK, 0, 2)]
    assert told(pe.pass_time(3 * CHANNEL_REPORT_NS)) == []
    notes = [action.text for _, action in pe.done if isinstance(action, Note) and action.kind == "channel"]
    assert notes == ["can0.2 carries nothing here", "can0 has both its channels"]


def test_it_is_no_fault_that_waits_and_no_other_state(pe: OnePe) -> None:
    before = pe.ask()
    pe.give(ChannelsLost(0, frozenset({1, 2})))
    after = pe.ask()
    assert (after[0].state, after[0].flags, after[1].reason) == (before[0].state, before[0].flags, before[1].reason)
    assert pages(pe.give(ChannelsLost(0, frozenset({1})))) == []


def test_one_channel_goes_when_the_other_comes(pe: OnePe) -> None:
    pe.give(ChannelsLost(0, frozenset({2})))
    assert told(pe.give(ChannelsLost(0, frozenset({1})))) == [
        (FaultCode.CHANNEL_BACK, 0, 2),
        (FaultCode.CHANNEL_LOST, 0, 1),
    ]


def test_a_gateway_tells_which_of_its_buses_it_is_and_tells_it_toward_the_manager() -> None:
    gateway = OnePe(twin(GATEWAY_TABLE))
    gateway.pass_time(5 * BEAT_NS)
    assert told(gateway.give(ChannelsLost(1, frozenset({1})))) == [(FaultCode.CHANNEL_LOST, 1, 1)]
    assert told(gateway.give(ChannelsLost(0, frozenset({2})))) == [(FaultCode.CHANNEL_LOST, 0, 2)]
    assert told(gateway.give(ChannelsLost(1, NONE))) == [(FaultCode.CHANNEL_BACK, 1, 1)]
    assert told(gateway.pass_time(CHANNEL_REPORT_NS + 100 * MS)) == [(FaultCode.CHANNEL_LOST, 0, 2)]
