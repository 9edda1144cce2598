"""A PE on two buses: what it carries across, and what it does not."""

from dataclasses import replace

import pytest

from agent.one_pe import (
    BEAT_NS,
    DEMAND,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RATE_ID,
    RUN_CONTROL,
    OnePe,
    command_frame,
    neighbour_state,
    rate_frame,
    sent,
)
from heronry_agent.core.vocabulary import Action
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import actuator_echo_id, emcy_id, heartbeat_id, state_id
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    Lease,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)
from heronry_wire.sansio import Received, Withdraw

UPLINK, RADIO = 0, 1


def forwarded(actions: list[Action], frame: Frame, port: int) -> bool:
    return frame in sent(actions, frame.can_id, port)


@pytest.mark.parametrize(
    "message",
    [
        Prepare(1, 7, 1007),
        Activate(1, 7, Step.GO, 1007),
        Ping(1, FAR, 0),
        Control(1, FAR, Operation.ACKNOWLEDGE),
        SliceHead(FAR, 7, 9, 5),
        SliceBody(FAR, 7, 1, b"12345"),
        Lease(1, 7, Step.GO, 1007),
        Alive(1, 0, frozenset({FAR})),
    ],
)
def test_commands_pass_down(message: Prepare) -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.command(Prepare(1, 6, 1006))
    frame = command_frame(message)
    actions = pe.hear(frame, UPLINK)
    assert forwarded(actions, frame, RADIO)
    assert not forwarded(actions, frame, UPLINK)


def test_slices_pass_only_toward_their_node() -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.command(Prepare(1, 7, 1007))
    for node in (NEIGHBOUR, NODE):
        frame = command_frame(SliceBody(node, 7, 1, b"12345"))
        assert not forwarded(pe.hear(frame), frame, RADIO)


def test_commands_from_beyond_are_neither_obeyed_nor_passed_on() -> None:
    pe = OnePe(GATEWAY_TABLE)
    for message in (Lease(1, 0, Step.PREPARED, 0), Alive(1, 0, frozenset()), Ping(1, NODE, 0)):
        assert pe.hear(command_frame(message), RADIO) == []
    assert pe.core.reign.term == 0


def test_stale_commands_are_not_passed_on() -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.command(Lease(5, 0, Step.PREPARED, 0))
    frame = command_frame(Lease(4, 0, Step.PREPARED, 0), 127)
    assert not forwarded(pe.hear(frame), frame, RADIO)


def test_the_lease_passes_once_in_a_period_of_the_far_bus() -> None:
    pe = OnePe(GATEWAY_TABLE)
    lease, passed = command_frame(Lease(1, 7, Step.GO_ALL, 1007)), 0
    for beat in range(100):  # of 20 ms on the near side, not quite regular
        pe.pass_time((19 + beat % 3) * MS)
        passed += forwarded(pe.hear(lease), lease, RADIO)
    assert passed == pytest.approx(20, abs=1)


def test_a_lease_or_alive_that_says_something_new_passes_at_once() -> None:
    pe = OnePe(GATEWAY_TABLE)
    for message in (
        Lease(1, 7, Step.BREAK, 1007),
        Lease(1, 7, Step.GO, 1007),
        Lease(1, 8, Step.GO, 1008),
        Lease(2, 8, Step.GO, 1008),
        Alive(2, 0, frozenset({FAR})),
        Alive(2, 1, frozenset({FAR, NODE})),
    ):
        frame = command_frame(message)
        assert forwarded(pe.hear(frame), frame, RADIO)
        assert not forwarded(pe.hear(frame), frame, RADIO)
    again = command_frame(Alive(2, 2, frozenset({FAR, NODE})))
    assert not forwarded(pe.hear(again), again, RADIO), "the sequence alone is nothing new"


def test_what_nodes_beyond_say_of_themselves_passes_up() -> None:
    pe = OnePe(GATEWAY_TABLE)
    for frame in (
        neighbour_state(0, node=FAR),
        Frame(emcy_id(FAR), bytes(8)),
        Frame(heartbeat_id(FAR), b"\x05"),
        encode_data(actuator_echo_id(FAR), Datum(FAR, DataType.FLOAT, 3, 0, -4.0)),
    ):
        assert forwarded(pe.hear(frame, RADIO), frame, UPLINK)
        assert not forwarded(pe.hear(frame, UPLINK), frame, UPLINK)
        assert not forwarded(pe.hear(frame, UPLINK), frame, RADIO)


def test_what_nodes_on_the_near_side_say_does_not_pass() -> None:
    pe = OnePe(GATEWAY_TABLE)
    for frame in (neighbour_state(0), Frame(emcy_id(NEIGHBOUR), bytes(8))):
        for port in (UPLINK, RADIO):
            actions = pe.hear(frame, port)
            assert sent(actions, frame.can_id) == []


def test_data_passes_where_the_slice_says_and_never_back() -> None:
    pe = OnePe(GATEWAY_TABLE)
    datum = rate_frame(1.0)
    assert pe.hear(datum) == []
    pe.configure(Slice(forward={RATE: (NEIGHBOUR, 0b11)}), 7)
    assert sent(pe.hear(datum, UPLINK), RATE_ID, RADIO) == [datum]
    assert sent(pe.hear(datum, UPLINK), RATE_ID, UPLINK) == []
    assert sent(pe.hear(datum, RADIO), RATE_ID, UPLINK) == [datum]
    foreign = rate_frame(1.0, node=FAR)
    assert sent(pe.hear(foreign, UPLINK), RATE_ID) == []
    assert pe.hear(Frame(RATE_ID, b"")) == []


def test_data_that_is_read_here_passes_too_and_own_data_goes_to_every_port_of_its_mask() -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.outputs[RUN_CONTROL.module] = {"demand": 1.0}
    pe.configure(Slice((RUN_CONTROL,), {RATE: NEIGHBOUR}, {DEMAND: 0b11}, {RATE: (NEIGHBOUR, 0b10)}), 7)
    pe.hear(neighbour_state(7))
    assert sent(pe.hear(rate_frame(2.0)), RATE_ID, RADIO) == [rate_frame(2.0)]
    actions = pe.pass_time(0)
    assert pe.seen[RUN_CONTROL.module] == {"": 2.0}
    assert len(sent(actions, 1536, UPLINK)) == len(sent(actions, 1536, RADIO)) == 1


def test_a_change_is_said_on_every_bus() -> None:
    pe = OnePe(GATEWAY_TABLE)
    actions = pe.configure(FLYING, 7)
    for port in (UPLINK, RADIO):
        assert any(frame.data[0] < 0x40 for frame in sent(actions, state_id(NODE), port))


def test_an_uplink_need_not_be_the_first_port() -> None:
    near, far = GATEWAY_TABLE.ports
    pe = OnePe(replace(GATEWAY_TABLE, ports=(far, near), uplink=1))
    lease = command_frame(Lease(1, 7, Step.BREAK, 1007))
    assert pe.hear(lease, 0) == []
    assert forwarded(pe.hear(lease, 1), lease, 0)


# A datum from beyond whose module may also run on this side of the gateway is exclusive there (rule 6).

CONTESTED_TABLE = replace(
    GATEWAY_TABLE, sources=(replace(GATEWAY_TABLE.sources[RATE], movable=True), *GATEWAY_TABLE.sources[1:])
)
FROM_BEYOND = Slice(forward={RATE: (FAR, 0b01)})


def datum_from_beyond(pe: OnePe, age_ns: int = 0) -> list[Action]:
    return pe.give(Received(RADIO, rate_frame(1.0, node=FAR), age_ns))


def test_what_may_run_on_this_side_too_is_sent_up_only_while_others_are_heard_there() -> None:
    for table, is_exclusive in ((CONTESTED_TABLE, True), (GATEWAY_TABLE, False)):
        pe = OnePe(table)
        pe.configure(FROM_BEYOND, 7)
        pe.command(Alive(1, 0, frozenset({NODE, FAR, NEIGHBOUR})))
        (frame,) = sent(datum_from_beyond(pe), RATE_ID, UPLINK)
        assert frame.data[0] == FAR
        pe.pass_time(60 * MS)
        assert bool(sent(datum_from_beyond(pe), RATE_ID, UPLINK)) is not is_exclusive
        pe.hear(neighbour_state(7, 1007))
        assert bool(sent(datum_from_beyond(pe), RATE_ID, UPLINK)) is not is_exclusive  # in doubt
        pe.command(Alive(1, 1, frozenset({NODE, FAR, NEIGHBOUR})))
        assert sent(datum_from_beyond(pe), RATE_ID, UPLINK)


def test_what_waits_of_it_is_withdrawn_when_nobody_counts_on_the_gateway_any_more() -> None:
    pe = OnePe(CONTESTED_TABLE)
    pe.configure(FROM_BEYOND, 7)
    pe.command(Alive(1, 0, frozenset({NODE, FAR})))
    told = pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    assert Withdraw(frozenset({RATE_ID})) in told
    assert not sent(datum_from_beyond(pe), RATE_ID, UPLINK)


def test_what_came_while_nobody_ran_is_not_sent_up_as_behind_it_may_be_that_it_has_moved() -> None:
    """The oldest of what waits shows for how long; where nothing is exclusive, all of it goes."""
    for table, is_exclusive in ((CONTESTED_TABLE, True), (GATEWAY_TABLE, False)):
        pe = OnePe(table)
        pe.configure(FROM_BEYOND, 7)
        pe.command(Alive(1, 0, frozenset({NODE, FAR, NEIGHBOUR})))
        for shows_it_ns, is_held in ((5 * MS, False), (5 * MS + 1, True)):
            pe.pass_time(10 * MS)
            pe.give(Received(UPLINK, neighbour_state(7, 1007), age_ns=shows_it_ns))
            assert bool(sent(datum_from_beyond(pe, age_ns=MS), RATE_ID, UPLINK)) is not (is_held and is_exclusive)
        assert bool(sent(datum_from_beyond(pe), RATE_ID, UPLINK)) is not is_exclusive
        pe.pass_time(1)
        assert sent(datum_from_beyond(pe), RATE_ID, UPLINK)


def test_what_is_sent_down_is_nobody_elses() -> None:
    pe = OnePe(CONTESTED_TABLE)
    pe.configure(Slice(forward={RATE: (NEIGHBOUR, 0b10)}), 7)
    pe.command(Alive(1, 0, frozenset({NODE, FAR})))
    assert not [one for one in pe.command(Alive(1, 1, frozenset({NEIGHBOUR}))) if isinstance(one, Withdraw)]


def test_a_manager_that_beats_slowly_is_heard_for_as_long_as_its_lease_lasts() -> None:
    for period_ns, hears in ((0, False), (5 * BEAT_NS, True)):
        pe = OnePe(replace(GATEWAY_TABLE, command_period_ns=period_ns))
        pe.command(Lease(1, 7, Step.GO, 1007))
        pe.pass_time(6 * BEAT_NS)
        assert pe.core.reign.hears_lease(pe.now_ns) is hears
