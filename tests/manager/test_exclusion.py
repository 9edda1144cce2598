"""Which PE may still drive an exclusive output, as the manager knows it: break before make."""

from pathlib import Path

import pytest

from heronry_dg.configuration import Configuration, Running
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_manager.core.membership.exclusion import Exclusion

MS = 1_000_000
T_LEASE = 100 * MS
PES = ["sensor_pe", "control_pe", "tail_pe"]


@pytest.fixture
def spec() -> Spec:
    text = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    on_control = "elevator_servo_2: {kind: actuator, pe: control_pe}"
    return loads(text.replace("elevator_servo_2: {kind: actuator, pe: tail_pe}", on_control), "two_tails.dg.yaml")


@pytest.fixture
def exclusion(spec: Spec) -> Exclusion:
    return Exclusion(spec)


def with_servo(number: int, pe: str, control_on: str = "control_pe") -> Configuration:
    return Configuration(
        {f"servo_driver_{number}": Running(pe, "only"), "elevator_control": Running(control_on, "only")}
    )


def activate(exclusion: Exclusion, configuration: Configuration) -> None:
    placed = exclusion.tokens(configuration)
    exclusion.activated(placed)
    for pe in PES:
        exclusion.reported(pe, placed)
    exclusion.named(PES, 0)


def test_nothing_waits_at_the_first_start(exclusion: Exclusion) -> None:
    placed = exclusion.tokens(with_servo(1, "tail_pe"))
    assert exclusion.must_break(placed, PES) == set()
    assert exclusion.demux_free_ns(placed, PES, 0) is None
    assert exclusion.identifiers_free_ns(placed, PES, 0) is None


def test_a_demux_that_moves_between_healthy_pes_breaks_first(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe"))
    placed = exclusion.tokens(with_servo(2, "control_pe"))
    assert exclusion.must_break(placed, PES) == {"tail_pe"}
    exclusion.activated(placed)
    exclusion.reported("tail_pe", placed)
    assert exclusion.must_break(placed, PES) == set()


def test_an_identifier_that_moves_breaks_first_and_one_that_stays_does_not(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe", control_on="control_pe"))
    stays = exclusion.tokens(with_servo(1, "tail_pe", control_on="control_pe"))
    moves = exclusion.tokens(with_servo(1, "tail_pe", control_on="sensor_pe"))
    assert exclusion.must_break(stays, PES) == set()
    assert exclusion.must_break(moves, PES) == {"control_pe"}


def test_the_demux_of_a_silent_pe_waits_for_its_lease_to_run_out(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe"))
    left = ["sensor_pe", "control_pe"]
    exclusion.named(PES, 60 * MS)
    exclusion.declared_down("tail_pe", 0)
    placed = exclusion.tokens(with_servo(2, "control_pe"))
    assert exclusion.must_break(placed, left) == set()
    assert exclusion.demux_free_ns(placed, left, 65 * MS) == 160 * MS
    assert exclusion.demux_free_ns(placed, left, 160 * MS) is None


def test_where_the_driver_reports_alives_a_lease_counts_from_the_first_one_without_the_pe(
    spec: Spec,
) -> None:
    exclusion = Exclusion(spec, tells_departures=True)
    activate(exclusion, with_servo(1, "tail_pe"))
    left = ["sensor_pe", "control_pe"]
    placed = exclusion.tokens(with_servo(2, "control_pe"))
    exclusion.named(left, 65 * MS)
    assert exclusion.demux_free_ns(placed, left, 300 * MS) == 400 * MS
    exclusion.said(PES, 301 * MS)  # an older ALIVE, which names the PE
    assert exclusion.demux_free_ns(placed, left, 302 * MS) == 402 * MS
    exclusion.said(left, 303 * MS)
    exclusion.said(left, 304 * MS)
    assert exclusion.demux_free_ns(placed, left, 305 * MS) == 403 * MS
    assert exclusion.demux_free_ns(placed, left, 403 * MS) is None


def test_time_in_which_the_manager_did_not_run_is_no_part_of_a_lease(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe"))
    exclusion.named(PES, 0)
    exclusion.slept(70 * MS)
    exclusion.declared_down("tail_pe", 0)
    placed = exclusion.tokens(with_servo(2, "control_pe"))
    assert exclusion.demux_free_ns(placed, ["sensor_pe", "control_pe"], 100 * MS) == 170 * MS


def test_the_identifiers_of_a_pe_declared_down_are_free_immediately(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe", control_on="control_pe"))
    exclusion.declared_down("control_pe", 0)
    placed = exclusion.tokens(with_servo(1, "tail_pe", control_on="sensor_pe"))
    assert exclusion.identifiers_free_ns(placed, ["sensor_pe", "tail_pe"], 65 * MS) is None


def test_time_in_which_the_manager_did_not_run_is_no_part_of_a_silence(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe", control_on="control_pe"))
    exclusion.named(PES, 0)
    placed, left = exclusion.tokens(with_servo(1, "tail_pe", control_on="sensor_pe")), ["sensor_pe", "tail_pe"]
    exclusion.slept(50 * MS)  # before the PE was heard
    exclusion.heard("control_pe")
    for _ in range(2):
        exclusion.slept(35 * MS)
    exclusion.declared_down("control_pe", 60 * MS)
    assert exclusion.identifiers_free_ns(placed, left, 150 * MS) == (60 + 70 + 65) * MS


def test_the_identifiers_of_a_pe_given_up_although_it_sends_wait_for_its_lease_to_run_out(
    exclusion: Exclusion,
) -> None:
    activate(exclusion, with_servo(1, "tail_pe", control_on="control_pe"))
    left = ["sensor_pe", "tail_pe"]
    placed = exclusion.tokens(with_servo(1, "tail_pe", control_on="sensor_pe"))
    assert exclusion.identifiers_free_ns(placed, left, 65 * MS) == 100 * MS
    assert exclusion.demux_free_ns(placed, left, 65 * MS) is None
    assert exclusion.identifiers_free_ns(placed, left, 100 * MS) is None


def test_a_pe_that_runs_what_another_manager_gave_it_must_break_whatever_could_be_placed_there(
    exclusion: Exclusion,
) -> None:
    exclusion.unknown("tail_pe")
    placed = exclusion.tokens(with_servo(2, "control_pe", control_on="sensor_pe"))
    assert exclusion.must_break(placed, PES) == {"tail_pe"}
    exclusion.reported("tail_pe", placed)
    assert exclusion.must_break(placed, PES) == set()


def test_a_new_incarnation_holds_nothing(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe"))
    exclusion.rebooted("tail_pe")
    placed = exclusion.tokens(with_servo(2, "control_pe"))
    assert exclusion.demux_free_ns(placed, ["sensor_pe", "control_pe"], 10 * MS) is None


def test_a_pe_that_missed_the_last_epoch_still_holds_what_it_ran(exclusion: Exclusion) -> None:
    activate(exclusion, with_servo(1, "tail_pe"))
    second = exclusion.tokens(with_servo(2, "control_pe"))
    exclusion.activated(second)  # ACTIVATE went out, and tail_pe has not answered
    third = exclusion.tokens(with_servo(2, "control_pe"))
    assert exclusion.must_break(third, PES) == {"tail_pe"}


def test_a_pe_beyond_the_radio_has_a_lease_of_its_own_slower_bus() -> None:
    spec = loads(Path("dg_specs/big_blue.dg.yaml").read_text(), "big_blue.dg.yaml")
    exclusion = Exclusion(spec)
    movable = {"image_archive": Running("ground", "only"), "guidance": Running("ground", "route")}
    activated = exclusion.tokens(Configuration(movable))
    exclusion.activated(activated)
    exclusion.named(["ground"], 0)
    elsewhere = exclusion.tokens(Configuration({"guidance": Running("nav", "route")}))
    # given up although it sends: five of its own heartbeat periods of 200 ms, not of the manager's 20 ms
    assert exclusion.identifiers_free_ns(elsewhere, ["nav"], 100 * MS) == 1000 * MS


def test_identifiers_of_a_pe_declared_down_early_wait_for_three_periods_and_a_quarter() -> None:
    text = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    found = Exclusion(loads(text.replace("bitrate: 1000000", "bitrate: 1000000, misses: 1"), "early.dg.yaml"))
    activate(found, with_servo(1, "tail_pe", control_on="control_pe"))
    placed, left = found.tokens(with_servo(1, "tail_pe", control_on="sensor_pe")), ["sensor_pe", "tail_pe"]
    found.named(PES, 20 * MS)
    found.declared_down("control_pe", 10 * MS)
    assert found.identifiers_free_ns(placed, left, 74 * MS) == 75 * MS
    found.named(["control_pe"], 74 * MS)  # the PE is back, and fails again: nothing is known of its silence
    assert found.identifiers_free_ns(placed, left, 76 * MS) == 174 * MS
    found.declared_down("control_pe", 20 * MS)
    found.slept(30 * MS)
    assert found.identifiers_free_ns(placed, left, 100 * MS) == 115 * MS
    assert found.identifiers_free_ns(placed, left, 115 * MS) is None


def test_the_ends_of_a_demux_are_one_thing_and_its_branches_another() -> None:
    exclusion = Exclusion(load(Path("dg_specs/examples/demux_paths.dg.yaml")))
    pes = ["flight", "tail_a", "tail_b", "tail_c"]

    def path(number: int, end_on: str) -> Configuration:
        limiter = Running("flight", "only")
        return Configuration(
            {f"elevator_limiter_{number}": limiter, f"limited_servo_{number}": Running(end_on, "only")}
        )

    first, second = exclusion.tokens(path(1, "tail_a")), exclusion.tokens(path(2, "tail_b"))
    exclusion.activated(first)
    for pe in pes:
        exclusion.reported(pe, first)
    exclusion.named(pes, 0)
    assert exclusion.must_break(second, pes) == {"tail_a"}, "the limiters share a PE"
    assert exclusion.demux_free_ns(second, ["flight", "tail_b", "tail_c"], 0) == T_LEASE
    assert exclusion.demux_free_ns(second, ["tail_a", "tail_b", "tail_c"], 0) is None
    exclusion.reported("tail_a", second)
    assert exclusion.must_break(second, pes) == set()
