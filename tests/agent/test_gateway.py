"""A PE on two buses: which frames it forwards, and which it does not."""

from dataclasses import replace

from agent.one_pe import (
    BEAT_NS,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RATE_ID,
    OnePe,
    neighbour_state,
    rate_frame,
    sent,
)
from heronry_agent.core.forwarding.gateway import MOST_AT_ONCE
from heronry_agent.core.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id, state_id
from heronry_wire.management import (
    Alive,
    Lease,
    Step,
)
from heronry_wire.sansio import Received, Withdraw
from lab.peers import command_frame

UPLINK, RADIO = 0, 1


def forwarded(actions: list[Action], frame: Frame, port: int) -> bool:
    return frame in sent(actions, frame.can_id, port)


def test_a_change_is_said_on_every_bus() -> None:
    pe = OnePe(GATEWAY_TABLE)
    actions = pe.configure(FLYING, 7)
    for port in (UPLINK, RADIO):
        assert any(frame.data[0] < 0x40 for frame in sent(actions, state_id(NODE), port))


def test_an_uplink_need_not_be_the_first_port() -> None:
    near, far = GATEWAY_TABLE.ports
    pe = OnePe(replace(GATEWAY_TABLE, ports=(far, near), uplink=1))
    lease = command_frame(Lease(1, 7, Step.BREAK, 1007))
    assert pe.hear(lease, port=0) == []
    assert forwarded(pe.hear(lease, port=1), lease, 0)


# A datum from beyond whose module may also run on this side of the gateway is exclusive there (protocol rule 6).

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


def test_exclusive_data_that_wait_are_withdrawn_when_the_gateway_is_not_available_any_more() -> None:
    pe = OnePe(CONTESTED_TABLE)
    pe.configure(FROM_BEYOND, 7)
    pe.command(Alive(1, 0, frozenset({NODE, FAR})))
    told = pe.command(Alive(1, 1, frozenset({NEIGHBOUR})))
    assert Withdraw(frozenset({RATE_ID})) in told
    assert not sent(datum_from_beyond(pe), RATE_ID, UPLINK)


def test_exclusive_data_from_a_pause_of_the_process_are_not_sent_up() -> None:
    """The oldest waiting frame shows the length of the pause; where no datum is exclusive, all of them are sent."""
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


def test_data_that_are_sent_down_are_not_exclusive() -> None:
    pe = OnePe(CONTESTED_TABLE)
    pe.configure(Slice(forward={RATE: (NEIGHBOUR, 0b10)}), 7)
    pe.command(Alive(1, 0, frozenset({NODE, FAR})))
    assert not [one for one in pe.command(Alive(1, 1, frozenset({NEIGHBOUR}))) if isinstance(one, Withdraw)]


def test_a_manager_that_beats_slowly_is_heard_for_as_long_as_its_lease_lasts() -> None:
    for period_ns, hears in ((0, False), (5 * BEAT_NS, True)):
        pe = OnePe(replace(GATEWAY_TABLE, command_period_ns=period_ns))
        pe.command(Lease(1, 7, Step.GO, 1007))
        pe.pass_time(6 * BEAT_NS)
        assert pe.core.followed_manager.hears_lease(pe.now_ns) is hears


REQUEST, ANSWER = (Frame(identify(FAR), bytes(8)) for identify in (sdo_request_id, sdo_response_id))


def test_sdo_of_a_node_beyond_is_forwarded_while_somebody_on_the_uplink_asks() -> None:
    pe = OnePe(GATEWAY_TABLE)
    assert not forwarded(pe.give(Received(RADIO, ANSWER)), ANSWER, UPLINK)
    assert not pe.give(Received(RADIO, REQUEST))  # a client on the far bus is heard there
    assert not forwarded(pe.give(Received(RADIO, ANSWER)), ANSWER, UPLINK)
    assert forwarded(pe.give(Received(UPLINK, REQUEST)), REQUEST, RADIO)
    assert forwarded(pe.give(Received(RADIO, ANSWER)), ANSWER, UPLINK)
    assert not forwarded(pe.give(Received(UPLINK, ANSWER)), ANSWER, UPLINK)
    pe.pass_time(2_001 * MS)
    assert not forwarded(pe.give(Received(RADIO, ANSWER)), ANSWER, UPLINK)


def test_requests_of_sdo_take_a_tenth_of_the_far_bus_however_fast_they_come() -> None:
    pe = OnePe(GATEWAY_TABLE)
    frame_ns = 135 * 1_000_000_000 // GATEWAY_TABLE.ports[RADIO].bitrate
    at_once = sum(forwarded(pe.give(Received(UPLINK, REQUEST)), REQUEST, RADIO) for _ in range(100))
    assert at_once == MOST_AT_ONCE
    pe.pass_time(10 * MOST_AT_ONCE * frame_ns)
    passed = 0
    for _ in range(1_000):
        passed += forwarded(pe.give(Received(UPLINK, REQUEST)), REQUEST, RADIO)
        pe.pass_time(frame_ns)
    assert passed in (100 + MOST_AT_ONCE - 1, 100 + MOST_AT_ONCE)
    pe.pass_time(10 * MOST_AT_ONCE * frame_ns)
    for _ in range(200):
        assert forwarded(pe.give(Received(UPLINK, REQUEST)), REQUEST, RADIO)  # at the pace of a manager none is dropped
        pe.pass_time(10 * frame_ns + 10)
