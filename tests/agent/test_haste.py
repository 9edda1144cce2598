"""When an agent's loop hurries: after a command of a manager, and with a fault of its own; not with every LEASE."""

from pathlib import Path

import pytest

from heronry_agent.shell.haste import Haste, needed_states
from heronry_dg.loader import load
from heronry_manager.core.tables import Compiler
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival
from heronry_wire.identifiers import (
    MANAGER_NODES,
    Command,
    emcy_id,
    emergency_event_id,
    heartbeat_id,
    management_id,
    state_id,
)

MS = 1_000_000
BEGIN_NS, CALM_NS = 1_000 * MS, 1_040 * MS
TABLE = Compiler(load(Path("dg_specs/elevator_and_chute.dg.yaml"))).table("tail_pe")


@pytest.fixture
def haste() -> Haste:
    """A PE that has been calm since CALM_NS."""
    made = Haste(TABLE)
    assert not made.is_calm(BEGIN_NS), "it has just started"
    assert not made.is_calm(CALM_NS - 1)
    assert made.is_calm(CALM_NS)
    return made


@pytest.mark.parametrize("manager", MANAGER_NODES)
@pytest.mark.parametrize("command", [Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.PING])
def test_a_command_is_urgent_for_two_periods(haste: Haste, manager: int, command: Command) -> None:
    haste.heard(
        [Arrival(CALM_NS, Frame(300, b"")), Arrival(CALM_NS, Frame(management_id(manager, command), b""))], CALM_NS
    )
    assert not haste.is_calm(CALM_NS + 40 * MS - 1)
    assert haste.is_calm(CALM_NS + 40 * MS)


def test_what_comes_in_every_period_is_not_urgent(haste: Haste) -> None:
    lease, alive = (management_id(126, command) for command in (Command.LEASE, Command.ALIVE))
    haste.heard([Arrival(CALM_NS, Frame(can_id, b"")) for can_id in (lease, alive, state_id(93), 300)], CALM_NS)
    haste.sends(state_id(TABLE.node_id), CALM_NS)
    haste.sends(heartbeat_id(TABLE.node_id), CALM_NS)
    assert haste.is_calm(CALM_NS)


@pytest.mark.parametrize("identify", [emcy_id, emergency_event_id])
def test_a_fault_of_its_own_is_urgent(haste: Haste, identify: object) -> None:
    assert callable(identify)
    haste.sends(identify(TABLE.node_id), CALM_NS)
    assert not haste.is_calm(CALM_NS)


def test_its_own_state_from_elsewhere_is_always_received() -> None:
    group = needed_states(TABLE)
    assert state_id(TABLE.node_id) not in group.identifiers, "another node has its node-ID"
    assert state_id(TABLE.node_id + 1) in group.identifiers
    assert group.every_ns == 30 * MS
