"""Protocol rule 6: when a PE drives its exclusive outputs, and when it stops by itself."""

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    DEMAND_ID,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    LEASE_NS,
    MS,
    NEIGHBOUR,
    NODE,
    SERVO_1,
    OnePe,
    neighbour_state,
    rate_frame,
    sent,
)
from heronry_agent.core.vocabulary import Action, StepModule
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.management import Alive, Lease, Step
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import PeFlags
from lab.peers import command_frame

ALL_NODES = frozenset({NEIGHBOUR, NODE})


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


def test_what_is_held_runs_on_but_for_what_is_exclusive() -> None:
    pe = flying()
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    actions = pe.pass_time(50 * MS)
    assert any(isinstance(a, StepModule) and a.module == CONTROL for a in actions)
    assert not drives(actions)


def test_another_node_under_our_node_id_stops_us_for_t_lease() -> None:
    pe = flying()
    pe.hear(neighbour_state(0, node=NODE))
    assert not drives(pe.fly(LEASE_NS - BEAT_NS, epoch=7, digest=1007))
    pe.hear(Frame(heartbeat_id(NODE), bytes(1)))  # this alone deceives no manager
    assert drives(pe.fly(2 * BEAT_NS, epoch=7, digest=1007))


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
    pe.command(Alive(1, 1, ALL_NODES))
    assert drives(pe.pass_time(2 * BEAT_NS))


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
    pe.command(Alive(1, 1, ALL_NODES))
    assert drives(pe.pass_time(50 * MS))


def test_after_a_silence_a_newer_epoch_is_seen_before_the_lease_is_over() -> None:
    pe = flying()
    pe.pass_time(2 * LEASE_NS)
    pe.hear(neighbour_state(7))
    pe.hear(neighbour_state(8))
    for _ in range(20):
        pe.hear(neighbour_state(7))
        assert not drives(pe.pass_time(BEAT_NS))


def test_a_pe_is_authorized_again_when_it_follows_or_the_manager_names_its_own_epoch() -> None:
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
        command_frame(Alive(1, 0, ALL_NODES)),
        command_frame(Lease(1, 7, Step.GO_ALL, 1007)),
    ):
        pe.give(Received(0, frame, age_ns=9 * LEASE_NS))
    assert not drives(pe.pass_time(50 * MS))
    pe.hear(neighbour_state(7))
    assert not drives(pe.pass_time(50 * MS))
    pe.command(Alive(1, 1, ALL_NODES))
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
