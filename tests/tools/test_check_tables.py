"""The oracle `tables`: one flight that breaks each of its rules, and one that breaks none."""

from dataclasses import replace

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.sim.flight.exhaustive import Setup, fly_case, read_case
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.tables import QUIET_NS, TableCheck
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning import prepared
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.part_transfer import Received
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, StatePage2
from scenarios.flights import flying

SPEC = load(shipped_spec_path("elevator_and_chute"))
PE = SPEC.pes["tail_pe"]
TABLES = prepared(SPEC, None).tables
WRITES_TABLE = Frame(sdo_request_id(PE.node_id), bytes.fromhex("c620200000100000"))
WRITES_PART = Frame(sdo_request_id(PE.node_id), bytes.fromhex("c626200128040000"))


@pytest.fixture
def check() -> TableCheck:
    return TableCheck(SPEC, (FlownSpec(SPEC, TABLES),))


def send(check: TableCheck, t_ns: int, frame: Frame) -> None:
    check.seen(Sent(t_ns, SPEC.manager.bus, "manager 126", frame))


def test_a_table_that_is_not_the_whole_own_one_is_found(check: TableCheck) -> None:
    check.took(1, PE.name, TABLES[PE.name])
    assert check.violations == []
    check.took(2, PE.name, replace(TABLES[PE.name], spec_digest="0" * 64))
    (violation,) = check.violations
    assert "not its own" in violation.story


def test_a_table_for_a_pe_that_follows_an_epoch_is_found(check: TableCheck) -> None:
    for page in (
        StatePage0(PeState.UNCONFIGURED, PeFlags(0), 1, 0, 0, 0),
        StatePage2(PeState.UNCONFIGURED, PeFlags(0), 1),
    ):
        check.state_sent(1_000 * MS, PE.node_id, page.encode())
    check.state_sent(1_000 * MS, PE.node_id, b"")
    send(check, 1_100 * MS, WRITES_TABLE)
    assert check.violations == []
    check.state_sent(2_000 * MS, PE.node_id, StatePage0(PeState.ACTIVE, PeFlags(0), 1, 7, 0, 0).encode())
    send(check, 2_000 * MS + QUIET_NS, WRITES_TABLE)
    assert check.violations == []
    send(check, 2_000 * MS + QUIET_NS - 1, WRITES_TABLE)
    (violation,) = check.violations
    assert "which flew" in violation.story
    send(check, 2_000 * MS + QUIET_NS - 1, WRITES_PART)
    assert len(check.violations) == 2


def test_a_table_that_is_sent_from_its_beginning_although_half_has_come_is_found(check: TableCheck) -> None:
    one, other = bytes(31) + b"\1", bytes(31) + b"\2"
    for pe, digest, length in [
        (PE.name, bytes(32), 0),
        (PE.name, one, 1024),
        (PE.name, one, 2048),
        ("nose_pe", other, 1024),
        (PE.name, one, 0),  # the whole was refused
        (PE.name, other, 1024),
        (PE.name, bytes(32), 0),  # the node has restarted
        (PE.name, one, 1024),
    ]:
        check.came(1, pe, Received(digest, length))
    assert check.violations == []
    check.came(2, PE.name, Received(other, 1024))
    (violation,) = check.violations
    assert "from its beginning" in violation.story


def test_a_transfer_that_takes_too_much_of_the_bus_is_found(check: TableCheck) -> None:
    answer = Frame(sdo_response_id(PE.node_id), bytes(8))
    for number in range(160):  # 135 bits each at 1 Mbit/s: 21.6 % of a tenth of a second
        assert (check.violations == []) is (number < 156)
        send(check, 5_000 * MS + number * 100_000, answer)
    assert len(check.violations) == 1
    send(check, 5_100 * MS, answer)
    check.seen(Sent(5_100 * MS, "another bus", "tail_pe", answer))
    assert len(check.violations) == 1


def test_a_simulation_without_blank_nodes_has_no_such_oracle_and_one_that_waits_for_ever_is_not_settled() -> None:
    simulation: Simulation = flying(SPEC)
    simulation.checks.took_table(1, PE.name, replace(TABLES[PE.name], spec=""))
    assert simulation.broken() == []
    simulation.fleet.kill(PE.name)
    simulation.fleet.make_blank(PE.name)
    simulation.fleet.restore(PE.name)
    simulation.fleet.cut(PE.name)
    simulation.fleet.mend(PE.name)
    simulation.run_for(3_000 * MS)
    assert [one.story for one in simulation.unsettled() if one.rule == "table"] == ["tail_pe waits for its table"]
    simulation.fleet.kill(PE.name)
    assert [one.story for one in simulation.unsettled() if one.rule == "table"] == []


@pytest.mark.parametrize(
    "case",
    [
        "blank pe:tail_pe: 2 lost everybody",
        "blank pe:tail_pe: 40 cut pe:tail_pe",
        "blank pe:control_pe: 60 crash pe:control_pe",
        "blank pe:sensor_pe: 50 crash primary",
        "retire pe:control_pe: 5 death pe:tail_pe",
        "restore pe:control_pe: 3 late-30 everybody",
    ],
)
def test_a_fault_at_a_message_of_a_transfer_or_a_retirement_breaks_no_rule(case: str) -> None:
    assert fly_case(SPEC, read_case(SPEC, case, Setup(standby=True, tables=True, keyed=True))) == []
