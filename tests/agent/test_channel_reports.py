"""Reports of a PE on a channel that carries nothing: immediately, every second, and when it is back; no others."""

from dataclasses import replace

from agent.one_pe import BEAT_NS, GATEWAY_TABLE, MS, NODE, OnePe, emergencies, sent
from heronry_agent.core.vocabulary import Action, ChannelsLost
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, FaultCode
from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import CHANNEL_REPORT_NS

NONE: frozenset[int] = frozenset()


def twin(table: PeTable) -> PeTable:
    return replace(table, ports=tuple(replace(port, channels=2) for port in table.ports))


def told(actions: list[Action]) -> list[tuple[FaultCode, int, int]]:
    """Reports on the uplink: code, port, channel."""
    reports = [e for e in emergencies(actions, port=0) if e.kind is ElementKind.CHANNEL]
    assert len(reports) == len(sent(actions, emcy_id(NODE)))
    return [(e.code, e.index, e.detail) for e in reports]


def test_a_gateway_tells_which_of_its_buses_it_is_and_tells_it_toward_the_manager() -> None:
    gateway = OnePe(twin(GATEWAY_TABLE))
    gateway.pass_time(5 * BEAT_NS)
    assert told(gateway.give(ChannelsLost(1, frozenset({1})))) == [(FaultCode.CHANNEL_LOST, 1, 1)]
    assert told(gateway.give(ChannelsLost(0, frozenset({2})))) == [(FaultCode.CHANNEL_LOST, 0, 2)]
    assert told(gateway.give(ChannelsLost(1, NONE))) == [(FaultCode.CHANNEL_BACK, 1, 1)]
    assert told(gateway.pass_time(CHANNEL_REPORT_NS + 100 * MS)) == [(FaultCode.CHANNEL_LOST, 0, 2)]
