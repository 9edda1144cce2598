"""Rule 6: when a PE drives what nobody else may drive at the same time, and when it stops by itself."""

import pytest

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    DEMAND,
    DEMAND_ID,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    LEASE_NS,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_MONITOR,
    SERVO_1,
    OnePe,
    command_frame,
    neighbour_state,
    rate_frame,
    sent,
    slice_messages,
    started,
)
from heronry_agent.core.running_modules import JUDGED_AFTER_NS
from heronry_agent.core.vocabulary import Action, StepModule
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id, heartbeat_id
from heronry_wire.management import Activate, Alive, Lease, Step
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import PeFlags

EVERYBODY = frozenset({NEIGHBOUR, NODE})


def flying(table: object = None) -> OnePe:
    """A PE that drives the branch and publishes the demand, with everything in order."""
    pe = OnePe() if table is None else OnePe(GATEWAY_TABLE)
    pe.outputs[CONTROL] = {"demand": 2.5}
    pe.configure(FLYING, 7)
    assert drives(pe.fly(100 * MS, epoch=7, digest=1007))
    return pe


def drives(actions: list[Action]) -> bool:
    """Tell whether the branch was stepped and the demand published; both or neither."""
    assert steps(actions) == bool(sent(actions, DEMAND_ID))
    return steps(actions)


def steps(actions: list[Action]) -> bool:
    """Tell whether the branch was stepped."""
    return any(isinstance(a, StepModule) and a.module == SERVO_1 for a in actions)


def test_without_a_word_of_alive_nothing_exclusive_is_driven() -> None:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demand": 2.5}
    pe.command(*slice_messages(FLYING, 7, 1007), Activate(1, 7, Step.GO_ALL, 1007))
    pe.hear(neighbour_state(7))
    assert not drives(pe.pass_time(50 * MS))
    assert PeFlags.OUTPUT_HELD in pe.ask()[0].flags
    pe.command(Alive(1, 0, EVERYBODY))
    assert drives(pe.pass_time(50 * MS))
    assert PeFlags.OUTPUT_HELD not in pe.ask()[0].flags


def test_what_is_held_runs_on_but_for_what_is_exclusive() -> None:
    pe = flying()
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    actions = pe.pass_time(50 * MS)
    assert any(isinstance(a, StepModule) and a.module == CONTROL for a in actions)
    assert not drives(actions)


def test_an_alive_that_no_longer_names_us_stops_us() -> None:
    pe = flying()
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    assert not drives(pe.pass_time(50 * MS))
    pe.command(Alive(1, 2, EVERYBODY))
    assert drives(pe.pass_time(50 * MS))


def test_alive_of_a_deposed_manager_says_nothing() -> None:
    pe = flying()
    pe.command(Alive(2, 1, frozenset({NEIGHBOUR})), manager=127)
    pe.command(Alive(1, 2, EVERYBODY))
    assert not drives(pe.pass_time(50 * MS))


def test_another_node_under_our_node_id_stops_us_for_t_lease() -> None:
    pe = flying()
    pe.hear(neighbour_state(0, node=NODE))
    assert not drives(pe.fly(LEASE_NS - BEAT_NS, epoch=7, digest=1007))
    pe.hear(Frame(heartbeat_id(NODE), bytes(1)))  # this alone deceives no manager
    assert drives(pe.fly(2 * BEAT_NS, epoch=7, digest=1007))


def test_a_pe_that_hears_nobody_stops_within_the_lease() -> None:
    pe = flying()
    assert steps(pe.pass_time(LEASE_NS - BEAT_NS))
    pe.pass_time(BEAT_NS)
    assert not drives(pe.pass_time(500 * MS))


def test_what_others_could_send_too_is_sent_for_two_periods_and_not_later() -> None:
    pe = flying()
    pe.hear(neighbour_state(7))
    until_ns = pe.now_ns + 2 * BEAT_NS
    actions = pe.pass_time(2 * BEAT_NS)
    assert {a.until_ns for a in actions if isinstance(a, Send) and a.frame.can_id == DEMAND_ID} == {until_ns}
    actions = pe.pass_time(2 * BEAT_NS)
    assert steps(actions)
    assert not sent(actions, DEMAND_ID)
    pe.hear(neighbour_state(7))
    assert not sent(pe.pass_time(2 * BEAT_NS), DEMAND_ID)
    pe.command(Alive(1, 1, EVERYBODY))
    assert drives(pe.pass_time(2 * BEAT_NS))


def test_a_report_is_not_believed_while_outputs_are_held_and_who_made_it_judges_afresh() -> None:
    pe = OnePe()
    pe.configure(Slice((*FLYING.modules, RUN_MONITOR), remote={RATE: NEIGHBOUR}, publish={DEMAND: 1}), 7)
    pe.reports[MONITOR] = (("device:left", 57),)
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    actions = pe.pass_time(50 * MS)
    assert not sent(actions, emcy_id(NODE))
    assert MONITOR in started(actions)
    assert not sent(pe.fly(JUDGED_AFTER_NS - 50 * MS, epoch=7, digest=1007), emcy_id(NODE))
    assert sent(pe.fly(150 * MS, epoch=7, digest=1007), emcy_id(NODE))


def test_the_silence_of_the_manager_alone_stops_nobody() -> None:
    pe = flying()
    for _ in range(20):
        pe.hear(neighbour_state(7))
        assert drives(pe.pass_time(2 * BEAT_NS))
    flags = pe.ask()[0].flags
    assert PeFlags.HEARS_LEASE not in flags


def test_after_a_pause_the_lease_is_over_before_anything_is_driven() -> None:
    pe = flying()
    pe.now_ns += 10 * LEASE_NS
    assert not drives(pe.give(Tick()) + pe.pass_time(50 * MS))


def test_after_a_pause_a_frame_without_an_epoch_is_not_enough() -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    pe.hear(Frame(heartbeat_id(NEIGHBOUR), b"\x05"))
    pe.hear(rate_frame(1.0))
    assert not drives(pe.pass_time(50 * MS))
    pe.command(Alive(1, 1, EVERYBODY))
    assert drives(pe.pass_time(50 * MS))


@pytest.mark.parametrize("epoch", [0, 7])
def test_after_a_silence_who_has_restarted_or_was_cut_off_as_well_proves_nothing(epoch: int) -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    pe.hear(neighbour_state(epoch))
    assert not drives(pe.pass_time(50 * MS))
    assert PeFlags.OUTPUT_HELD in pe.ask()[0].flags
    pe.command(Alive(1, 1, EVERYBODY))
    assert drives(pe.pass_time(50 * MS))


def test_after_a_silence_without_a_manager_it_is_enough_to_hear_others_for_the_lease() -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    held_ns = 0
    while not drives(pe.give(Received(0, neighbour_state(7))) + pe.pass_time(BEAT_NS)):
        held_ns += BEAT_NS
    assert LEASE_NS - BEAT_NS <= held_ns <= LEASE_NS + BEAT_NS


def test_after_a_silence_a_newer_epoch_is_seen_before_the_lease_is_over() -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    pe.hear(neighbour_state(7))
    pe.hear(neighbour_state(8))
    for _ in range(20):
        pe.hear(neighbour_state(7))
        assert not drives(pe.pass_time(BEAT_NS))


def test_a_neighbour_on_a_newer_epoch_shows_that_we_were_overtaken() -> None:
    pe = flying()
    pe.hear(neighbour_state(8))
    assert not drives(pe.pass_time(50 * MS))


@pytest.mark.parametrize("epoch", [0, 6, 7])
def test_a_neighbour_on_our_epoch_or_an_older_one_or_none_shows_nothing(epoch: int) -> None:
    pe = flying()
    pe.hear(neighbour_state(epoch))
    assert drives(pe.pass_time(50 * MS))


def test_a_lease_of_an_epoch_that_we_never_staged_stops_us_once_it_is_activated() -> None:
    pe = flying()
    pe.command(Lease(1, 8, Step.PREPARED, 1008))
    assert drives(pe.pass_time(50 * MS))
    pe.command(Lease(1, 8, Step.BREAK, 1008))
    assert not drives(pe.pass_time(50 * MS))


def test_a_lease_with_another_digest_under_our_number_stops_us() -> None:
    pe = flying()
    pe.command(Lease(1, 7, Step.GO_ALL, 999))
    assert not drives(pe.pass_time(50 * MS))


def test_following_settles_it_and_so_does_the_manager_who_names_our_own() -> None:
    pe = flying()
    pe.hear(neighbour_state(8))
    pe.command(Lease(1, 7, Step.GO_ALL, 1007))
    assert drives(pe.pass_time(50 * MS))
    pe.hear(neighbour_state(8))
    pe.configure(FLYING, 8)
    assert drives(pe.pass_time(50 * MS))


def test_a_gateway_is_not_comforted_by_what_it_hears_beyond() -> None:
    pe = flying(GATEWAY_TABLE)
    pe.pass_time(LEASE_NS)
    pe.hear(neighbour_state(7, node=FAR), port=1)
    assert not drives(pe.pass_time(50 * MS))
    pe.hear(neighbour_state(8, node=FAR), port=1)
    pe.hear(neighbour_state(7))
    assert not drives(pe.pass_time(50 * MS)), "a newer epoch counts from wherever it is seen"


def test_what_cannot_run_elsewhere_is_never_held() -> None:
    pe = OnePe()
    pe.configure(Slice(), 7)
    pe.pass_time(10 * LEASE_NS)
    assert PeFlags.OUTPUT_HELD not in pe.ask()[0].flags


def test_old_frames_taken_after_a_pause_prove_nothing_even_when_a_deadline_passed_first() -> None:
    pe = flying()
    pe.now_ns += 10 * LEASE_NS
    pe.give(Tick())
    for frame in (
        neighbour_state(7),
        command_frame(Alive(1, 0, EVERYBODY)),
        command_frame(Lease(1, 7, Step.GO_ALL, 1007)),
    ):
        pe.give(Received(0, frame, age_ns=9 * LEASE_NS))
    assert not drives(pe.pass_time(50 * MS))
    pe.hear(neighbour_state(7))
    assert not drives(pe.pass_time(50 * MS))
    pe.command(Alive(1, 1, EVERYBODY))
    assert drives(pe.pass_time(50 * MS))


def test_a_frame_that_came_before_another_takes_nothing_back() -> None:
    pe = flying()
    pe.hear(neighbour_state(7))
    pe.give(Received(0, neighbour_state(7, node=FAR), age_ns=10 * LEASE_NS))
    assert drives(pe.pass_time(50 * MS))


def test_a_state_frame_of_another_length_proves_nothing_and_is_counted() -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    malformed = Frame(neighbour_state(7).can_id, neighbour_state(7).data[:7])
    pe.hear(malformed)
    assert not drives(pe.pass_time(50 * MS))
    assert pe.core.counts["malformed state", malformed.can_id] == 1
