"""Suspect, ask, declare, and let back in: scenarios on the record of one PE."""

from pathlib import Path

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_manager.core.health import Change, Health, HealthChange, Standing
from heronry_wire.protocol_times import FORGIVEN_AFTER_NS, HOLD_DOWN_PERIODS, LEASE_PERIODS, LONGEST_HOLD_DOWN_NS

MS = 1_000_000
PERIOD = 20 * MS
PES = ("sensor_pe", "control_pe", "tail_pe")


@pytest.fixture(scope="module")
def spec() -> Spec:
    return loads(Path("dg_specs/elevator_and_chute.dg.yaml").read_text(), "elevator_and_chute.dg.yaml")


def changes(found: list[HealthChange]) -> list[tuple[str, Change]]:
    return [(one.pe, one.change) for one in found]


def everybody_up(spec: Spec) -> Health:
    health = Health(spec, 0, 1000 * MS)
    for pe in spec.pes:
        assert changes(health.heard(pe, 1, 0)) == [(pe, Change.JOINED)]
    assert not health.starting()
    return health


def beat_until(health: Health, pes: list[str], start_ns: int, end_ns: int) -> list[tuple[str, Change]]:
    found = []
    for now in range(start_ns, end_ns, PERIOD):
        for pe in pes:
            found += changes(health.heard(pe, 1, now))
        found += changes(health.tick(now))
    return found


def test_a_new_reign_waits_for_whom_it_is_told_to_unless_the_operator_keeps_them_out(spec: Spec) -> None:
    health = everybody_up(spec)
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


def test_a_new_reign_waits_no_longer_for_who_has_begun_anew(spec: Spec) -> None:
    health = everybody_up(spec)
    health.await_again(PES, 70 * MS, 1000 * MS)  # all are up: for nobody
    assert not health.starting()
    health.tick(25 * MS)
    health.tick(65 * MS)
    health.await_again(["tail_pe"], 70 * MS, 1000 * MS)
    assert health.starting()
    assert changes(health.heard("tail_pe", 2, 80 * MS)) == [("tail_pe", Change.HEARD_AGAIN)]
    assert not health.starting()


def test_a_new_reign_waits_no_longer_for_who_does_not_even_speak(spec: Spec) -> None:
    health = everybody_up(spec)
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


def test_a_missed_period_makes_suspect_and_three_make_it_lost(spec: Spec) -> None:
    health = everybody_up(spec)
    others = ["control_pe", "sensor_pe"]
    for pe in others:
        health.heard(pe, 1, 20 * MS)
    assert changes(health.tick(25 * MS)) == [("tail_pe", Change.SUSPECTED)]
    assert "tail_pe" in health.counted_on()
    for pe in others:
        health.heard(pe, 1, 60 * MS)
    assert changes(health.tick(64 * MS)) == []
    (lost,) = health.tick(65 * MS)
    assert (lost.pe, lost.change, lost.last_heard_ns) == ("tail_pe", Change.LOST, 0)
    assert sorted(health.counted_on()) == others


def test_a_suspect_that_answers_is_up_again(spec: Spec) -> None:
    health = everybody_up(spec)
    health.tick(26 * MS)
    assert health.standing("tail_pe") is Standing.SUSPECT
    assert changes(health.heard("tail_pe", 1, 27 * MS)) == [("tail_pe", Change.ANSWERED)]
    assert health.standing("tail_pe") is Standing.UP


def test_a_reboot_inside_the_window_is_a_loss_and_a_return(spec: Spec) -> None:
    health = everybody_up(spec)
    found = health.heard("tail_pe", 2, 30 * MS)
    assert changes(found) == [("tail_pe", Change.REBOOTED), ("tail_pe", Change.HEARD_AGAIN)]
    assert "rebooted" in found[0].cause


def test_who_returns_is_held_down_and_a_gap_starts_it_again(spec: Spec) -> None:
    health = everybody_up(spec)
    pes = list(spec.pes)
    others = [pe for pe in pes if pe != "tail_pe"]
    beat_until(health, others, PERIOD, 200 * MS)
    assert health.standing("tail_pe") is Standing.DOWN
    assert beat_until(health, pes, 200 * MS, 300 * MS) == [("tail_pe", Change.HEARD_AGAIN)]
    assert beat_until(health, others, 300 * MS, 400 * MS) == []  # a gap: back to the start
    found = beat_until(health, pes, 400 * MS, 400 * MS + (HOLD_DOWN_PERIODS + 1) * PERIOD)
    assert found == [("tail_pe", Change.HEARD_AGAIN), ("tail_pe", Change.JOINED)]


def test_what_flaps_is_held_down_longer_each_time(spec: Spec) -> None:
    health = everybody_up(spec)
    waits = []
    now = PERIOD
    for _ in range(4):
        health.fail("tail_pe", "because", now)
        start = now
        while "tail_pe" not in health.counted_on():
            now += PERIOD
            beat_until(health, list(spec.pes), now, now + 1)
        waits.append(now - start)
    assert [wait // waits[0] for wait in waits] == [1, 1, 3, 7]
    assert waits == sorted(waits)


def test_where_all_fall_silent_at_once_nothing_is_held_against_them(spec: Spec) -> None:
    health = everybody_up(spec)
    for round_ns in range(0, 3000 * MS, 1000 * MS):
        for at_ns in range(round_ns, round_ns + 500 * MS, PERIOD):
            for pe in PES:
                health.heard(pe, 1, at_ns)
            health.tick(at_ns)
        assert sorted(health.counted_on()) == sorted(PES)
        health.tick(round_ns + 550 * MS)
        lost = health.tick(round_ns + 600 * MS)
        assert changes(lost) == [(pe, Change.LOST) for pe in PES]
        assert health.hears_nobody(round_ns + 600 * MS)
        assert health.take_back() == [*PES]
        assert health.take_back() == []
    assert [health.losses(pe) for pe in PES] == [0, 0, 0]


def test_who_was_lost_before_the_others_fell_silent_has_lost_it_itself(spec: Spec) -> None:
    health = everybody_up(spec)
    for at_ns in range(0, 200 * MS, PERIOD):
        for pe in PES[1:]:
            health.heard(pe, 1, at_ns)
        health.tick(at_ns)
    health.tick(230 * MS)
    health.tick(300 * MS)
    assert health.hears_nobody(300 * MS)
    assert health.take_back() == [*PES[1:]]
    assert [health.losses(pe) for pe in PES] == [1, 0, 0]


def test_who_is_never_heard_is_absent_when_the_window_closes(spec: Spec) -> None:
    health = Health(spec, 0, 1000 * MS)
    health.heard("sensor_pe", 1, 990 * MS)
    health.heard("control_pe", 1, 990 * MS)
    assert health.starting()
    assert health.next_deadline_ns() == 1000 * MS
    assert changes(health.tick(1000 * MS)) == [("tail_pe", Change.ABSENT)]
    assert not health.starting()


def test_a_pe_behind_a_slow_bus_is_given_its_own_period() -> None:
    spec = loads(Path("dg_specs/big_blue.dg.yaml").read_text(), "big_blue.dg.yaml")
    health = Health(spec, 0, 1000 * MS)
    assert health.period_ns("ground") == 200 * MS
    assert health.period_ns("comms") == PERIOD


def test_a_long_hold_down_does_not_forgive_itself_and_a_good_minute_does(spec: Spec) -> None:
    health, now = everybody_up(spec), 0
    held = []
    for _ in range(14):
        health.fail("tail_pe", "it does not acknowledge", now)
        now += PERIOD
        health.heard("tail_pe", 1, now)
        held.append(health.held_down_for_ns("tail_pe", now))
        while not health.is_counted_on("tail_pe"):
            now += PERIOD
            health.heard("tail_pe", 1, now)
            health.tick(now)
    assert held[-4:] == [LONGEST_HOLD_DOWN_NS] * 4
    beat_until(health, ["tail_pe"], now, now + FORGIVEN_AFTER_NS + PERIOD)
    health.fail("tail_pe", "it does not acknowledge", now + FORGIVEN_AFTER_NS + PERIOD)
    assert health.losses("tail_pe") == 1


def test_in_flight_nobody_is_waited_for_longer_than_a_silence_may_last(spec: Spec) -> None:
    health = Health(spec, 0, 5_000 * MS)
    health.heard("tail_pe", 1, 0)
    health.in_flight(0)
    health.heard("sensor_pe", 1, 10 * MS)
    health.in_flight(10 * MS)
    assert (Change.ABSENT in {change for _, change in changes(health.tick(79 * MS))}) is False
    assert ("control_pe", Change.ABSENT) in changes(health.tick(80 * MS))
    assert health.cause("control_pe") == "not heard in the start-up window"
    health.in_flight(90 * MS)
    assert not health.starting()
    assert changes(health.heard("control_pe", 1, 90 * MS)) == [("control_pe", Change.HEARD_AGAIN)]


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


DEAF_NS = LEASE_PERIODS * PERIOD


def speak(health: Health, deaf: set[str], start_ns: int, end_ns: int) -> list[tuple[str, Change]]:
    """Let everybody beat; these hear no lease."""
    found = []
    for now in range(start_ns, end_ns + 1, PERIOD):
        for pe in PES:
            found += changes(health.heard(pe, 1, now, hears_lease=pe not in deaf))
        found += changes(health.tick(now))
    return found


def test_who_speaks_and_does_not_hear_is_failed_after_t_lease(spec: Spec) -> None:
    health = everybody_up(spec)
    assert speak(health, {"tail_pe"}, PERIOD, PERIOD + DEAF_NS) == []
    assert speak(health, {"tail_pe"}, 2 * PERIOD + DEAF_NS, 2 * PERIOD + DEAF_NS) == [("tail_pe", Change.FAILED)]
    assert health.cause("tail_pe") == "it hears no lease"


def test_who_hears_in_between_is_left_in_peace(spec: Spec) -> None:
    health = everybody_up(spec)
    for start in range(PERIOD, 20 * DEAF_NS, DEAF_NS):
        assert speak(health, {"tail_pe"}, start, start + DEAF_NS - 2 * PERIOD) == []
        assert speak(health, set(), start + DEAF_NS - PERIOD, start + DEAF_NS - PERIOD) == []


def test_a_deaf_pe_is_not_taken_back_before_it_hears(spec: Spec) -> None:
    health = everybody_up(spec)
    speak(health, {"tail_pe"}, PERIOD, 100 * PERIOD)
    assert health.standing("tail_pe") is Standing.RETURNING
    assert health.next_deadline_ns() > 100 * PERIOD
    assert speak(health, set(), 101 * PERIOD, 101 * PERIOD) == [("tail_pe", Change.JOINED)]


def test_where_most_are_deaf_it_is_the_manager_that_is_not_heard(spec: Spec) -> None:
    health = everybody_up(spec)
    assert speak(health, {"tail_pe", "sensor_pe"}, PERIOD, 100 * PERIOD) == []
    assert speak(health, set(PES), 101 * PERIOD, 200 * PERIOD) == []
    assert health.counted_on() == list(PES)
