"""A table that contradicts itself is refused at the start; the message of a broken invariant has the recent events."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from agent.one_pe import FLYING, TABLE, OnePe
from heronry_agent.core.agent import AgentCore
from heronry_wire.pe_table import DeviceEntry, PeTable, SourceEntry, TableError, VariableEntry
from heronry_wire.sansio import InvariantError, Tick


def with_source(**changes: object) -> PeTable:
    first, *rest = TABLE.sources
    return replace(TABLE, sources=(replace(first, **changes), *rest))


def with_version(version: int) -> PeTable:
    """The table, with this version of every variable that a mode gives."""
    modules = []
    for module in TABLE.modules:
        modes = (replace(mode, gives=dict.fromkeys(mode.gives, version)) for mode in module.modes)
        modules.append(replace(module, modes=tuple(modes)))
    return replace(TABLE, modules=tuple(modules))


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (replace(TABLE, variables={**TABLE.variables, "rate": VariableEntry("FLOTE", None)}), "no CANaerospace type"),
        (with_source(variable="nothing"), "no CANaerospace type"),
        (with_source(identifier=1536), "share an identifier"),
        (with_source(period_ns=0), "the period of"),
        (replace(TABLE, ports=(replace(TABLE.ports[0], heartbeat_ns=0),)), "heartbeat period of bus"),
        (replace(TABLE, devices=(DeviceEntry("x", "sensor", 12),)), "not a PE"),
        (replace(TABLE, sources=TABLE.sources[:1]), "but the table has no source for it"),
        (
            replace(TABLE, sources=(*TABLE.sources[:2], SourceEntry("monitor", "rate", 5, 1))),
            "but the table has no source for it",
        ),
        (with_version(16), "gives version 16"),
    ],
)
def test_a_table_that_contradicts_itself_is_refused_with_the_remedy(table: PeTable, says: str) -> None:
    with pytest.raises(TableError, match=says) as caught:
        AgentCore(table, 0, 0)
    assert "heronry table" in str(caught.value)


@pytest.mark.parametrize(
    "break_it",
    [
        lambda core: core.active_configuration.live.pop(1),
        lambda core: core.active_configuration.live.update({4: 0}),
        lambda core: core.active_configuration.failed.add(1),
        lambda core: core.modules.schedule.stop(1),
    ],
)
def test_a_broken_invariant_tells_what_happened_before(break_it: Callable[[AgentCore], object]) -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    break_it(pe.core)
    with pytest.raises(InvariantError, match=r"recent events:\n") as caught:
        pe.core.validate()
    assert "Received(port=0" in str(caught.value)


def test_a_driver_that_lets_time_go_back_is_told() -> None:
    pe = OnePe()
    with pytest.raises(ValueError, match="monotonic"):
        pe.core.step(pe.now_ns - 1, Tick())
