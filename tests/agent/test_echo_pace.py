"""How often an output is echoed: as often as the table says, or at every command."""

from dataclasses import replace

import pytest

from agent.one_pe import FLYING, MS, NODE, TABLE, OnePe, sent
from heronry_agent.core.agent import AgentCore
from heronry_agent.core.modules.echo_pace import EchoPace
from heronry_wire.identifiers import actuator_echo_id
from heronry_wire.pe_table import PeTable, TableError

SECOND = 1_000 * MS


def table(echoes_per_s: int) -> PeTable:
    return replace(TABLE, echoes_per_s=echoes_per_s)


def echoes_in(pace: EchoPace, module: int, times_ns: range) -> list[int]:
    return [now_ns for now_ns in times_ns if pace.is_due(module, now_ns)]


def test_the_first_echo_goes_out_at_once_and_the_others_follow_a_grid() -> None:
    pace = EchoPace(table(10), every_echo=False)
    assert echoes_in(pace, 1, range(7 * MS, SECOND, 25 * MS)) == [(7 + 100 * n) * MS for n in range(10)]


def test_late_steps_do_not_lower_the_rate_and_a_pause_gives_no_burst() -> None:
    pace = EchoPace(table(10), every_echo=False)
    assert len(echoes_in(pace, 1, range(0, 10 * SECOND, 33 * MS))) == 100
    assert echoes_in(pace, 1, range(20 * SECOND, 20 * SECOND + 101 * MS, 10 * MS)) == [
        20 * SECOND,
        20 * SECOND + 100 * MS,
    ]


def test_each_output_has_its_own_grid() -> None:
    pace = EchoPace(table(1), every_echo=False)
    assert [pace.is_due(module, now_ns) for now_ns in (0, 5) for module in (1, 2)] == [True, True, False, False]


def test_a_simulated_plant_gets_every_command() -> None:
    pace = EchoPace(table(1), every_echo=True)
    assert len(echoes_in(pace, 1, range(0, SECOND, 25 * MS))) == 40


@pytest.mark.parametrize(("echoes_per_s", "every_echo", "expected"), [(10, False, 10), (2, False, 2), (2, True, 40)])
def test_a_pe_echoes_its_servo_as_often(echoes_per_s: int, every_echo: bool, expected: int) -> None:
    pe = OnePe(table(echoes_per_s))
    pe.core = AgentCore(table(echoes_per_s), 5, pe.now_ns, every_echo=every_echo)

    pe.configure(FLYING, 1)
    assert abs(len(sent(pe.fly(SECOND, epoch=1, digest=1001), actuator_echo_id(NODE))) - expected) <= 1


def test_a_table_without_echoes_is_refused() -> None:
    with pytest.raises(TableError, match="outputs are echoed 0 times a second, which must be positive"):
        OnePe(PeTable.from_json(table(0).to_json()))
