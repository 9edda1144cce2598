"""A PE is suspected, gets PING, is lost, and becomes available again: scenarios on the record of one PE."""

from pathlib import Path

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_manager.core.membership.health import (
    Change,
    Health,
    HealthChange,
)

MS = 1_000_000
PERIOD = 20 * MS
PES = ("sensor_pe", "control_pe", "tail_pe")


@pytest.fixture(scope="module")
def spec() -> Spec:
    return loads(Path("dg_specs/elevator_and_chute.dg.yaml").read_text(), "elevator_and_chute.dg.yaml")


def changes(found: list[HealthChange]) -> list[tuple[str, Change]]:
    return [(one.pe, one.change) for one in found]


def all_up(spec: Spec) -> Health:
    health = Health(spec, 0, 1000 * MS)
    for pe in spec.pes:
        assert changes(health.heard(pe, 1, 0)) == [(pe, Change.JOINED)]
    assert not health.starting()
    return health


def test_a_new_mastership_waits_for_the_given_pes_unless_the_operator_keeps_them_out(spec: Spec) -> None:
    health = all_up(spec)
    health.tick(25 * MS)
    health.tick(65 * MS)
    health.bar("tail_pe", "failed", 70 * MS)
    health.heard("control_pe", 1, 70 * MS)
    health.await_again(PES, 70 * MS, 1000 * MS)
    assert health.starting()
    assert health.awaited_again() == ["sensor_pe", "control_pe"]
    assert changes(health.heard("sensor_pe", 1, 80 * MS)) == [("sensor_pe", Change.JOINED)]
    assert health.awaited_again() == ["control_pe"]
    assert changes(health.tick(1070 * MS))[-1] == ("control_pe", Change.ABSENT)
    assert health.awaited_again() == []


def test_a_new_mastership_waits_no_longer_for_a_pe_that_has_begun_anew(spec: Spec) -> None:
    health = all_up(spec)
    health.await_again(PES, 70 * MS, 1000 * MS)  # all are up: for none
    assert not health.starting()
    health.tick(25 * MS)
    health.tick(65 * MS)
    health.await_again(["tail_pe"], 70 * MS, 1000 * MS)
    assert health.starting()
    assert changes(health.heard("tail_pe", 2, 80 * MS)) == [("tail_pe", Change.HEARD_AGAIN)]
    assert not health.starting()


def test_a_new_mastership_waits_no_longer_for_a_pe_that_sends_nothing(spec: Spec) -> None:
    health = all_up(spec)
    health.tick(25 * MS)
    health.tick(65 * MS)
    health.await_again(["sensor_pe", "tail_pe"], 70 * MS, 1000 * MS)
    health.spoke("tail_pe", 1, 90 * MS)
    assert health.next_deadline_ns() == 135 * MS
    assert health.tick(134 * MS) == []
    assert changes(health.tick(135 * MS)) == [("sensor_pe", Change.ABSENT)]
    assert health.awaited_again() == ["tail_pe"]
    assert health.starting()
    assert changes(health.tick(155 * MS)) == [("tail_pe", Change.ABSENT)]
    assert not health.starting()


def test_the_loss_of_a_pe_before_the_others_fell_silent_is_not_discounted(spec: Spec) -> None:
    health = all_up(spec)
    for at_ns in range(0, 200 * MS, PERIOD):
        for pe in PES[1:]:
            health.heard(pe, 1, at_ns)
        health.tick(at_ns)
    health.tick(230 * MS)
    health.tick(300 * MS)
    assert health.hears_no_pe(300 * MS)
    assert health.discount_losses() == [*PES[1:]]
    assert [health.losses(pe) for pe in PES] == [1, 0, 0]


def test_a_pe_behind_a_slow_bus_is_given_its_own_period() -> None:
    spec = loads(Path("dg_specs/big_blue.dg.yaml").read_text(), "big_blue.dg.yaml")
    health = Health(spec, 0, 1000 * MS)
    assert health.period_ns("ground") == 200 * MS
    assert health.period_ns("comms") == PERIOD


def test_a_pe_that_is_barred_before_it_was_heard_is_not_waited_for(spec: Spec) -> None:
    health = Health(spec, 0, 5_000 * MS)
    for pe in ("tail_pe", "sensor_pe"):
        health.heard(pe, 1, 0)
    assert health.bar("control_pe", "the operator says so", 0) == []
    assert not health.starting()
    assert health.heard("control_pe", 1, 20 * MS) == []
    assert health.forgive("control_pe")
    assert not health.forgive("control_pe")
    assert changes(health.heard("control_pe", 1, 40 * MS)) == [("control_pe", Change.HEARD_AGAIN)]
