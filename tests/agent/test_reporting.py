"""What a PE says of itself, and how often."""

from agent.one_pe import BEAT_NS, FAR, FLYING, GATEWAY_TABLE, MS, NODE, OnePe, neighbour_state, pages, sent
from heronry_agent.core.vocabulary import Note
from heronry_wire.canaerospace import DataType
from heronry_wire.frame import Frame
from heronry_wire.identifiers import actuator_echo_id, emcy_id, heartbeat_id, state_id
from heronry_wire.management import Ping
from heronry_wire.node_services import Identification, decode_service, encode_service, read_identification, request
from heronry_wire.state_frames import PeState, StatePage0, StatePage1


def test_boot_up_then_a_heartbeat_each_second() -> None:
    pe = OnePe()
    actions = pe.pass_time(2_500 * MS)
    assert [frame.data for frame in sent(actions, heartbeat_id(NODE))] == [b"\x00", b"\x7f", b"\x7f"]
    pe.configure(FLYING, 7)
    assert [frame.data for frame in sent(pe.pass_time(1_000 * MS), heartbeat_id(NODE))] == [b"\x05"]


def test_page_0_each_period_at_the_nodes_place_and_page_1_every_tenth() -> None:
    pe = OnePe()
    pe.pass_time(2_000 * MS)
    beats = [(at_ns, page) for at_ns, action in pe.done for page in pages([action])]
    zeros = [(at_ns, page) for at_ns, page in beats if isinstance(page, StatePage0)]
    ones = [page for _, page in beats if isinstance(page, StatePage1)]
    assert len(zeros) == 100
    assert len(ones) == 10
    assert {at_ns % BEAT_NS for at_ns, _ in zeros} == {BEAT_NS // 34}
    assert [page.sequence for _, page in zeros] == list(range(100))
    assert {page.incarnation for _, page in zeros} == {5}
    assert {page.state for _, page in zeros} == {PeState.UNCONFIGURED}


def test_a_pause_is_not_made_up_for() -> None:
    pe = OnePe()
    pe.pass_time(100 * MS)
    pe.now_ns += 5_000 * MS
    assert len(pages(pe.pass_time(0))) <= 2


def test_a_gateway_beats_on_each_bus_at_that_buss_period() -> None:
    pe = OnePe(GATEWAY_TABLE)
    actions = pe.pass_time(1_000 * MS)
    near = [page for page in pages(actions, port=0) if isinstance(page, StatePage0)]
    far = [page for page in pages(actions, port=1) if isinstance(page, StatePage0)]
    assert (len(near), len(far)) == (50, 10)
    assert [page.sequence for page in far] == list(range(10))


def test_ping_is_answered_with_both_pages_and_only_by_whom_it_names() -> None:
    pe = OnePe()
    assert [type(page) for page in pages(pe.command(Ping(1, NODE, 1)))] == [StatePage0, StatePage1]
    assert len(pages(pe.command(Ping(1, 0, 1)))) == 2
    assert pe.command(Ping(1, 92, 1)) == []


def test_another_node_with_our_id_is_noted_once_and_counted() -> None:
    pe = OnePe()
    (note,) = pe.hear(neighbour_state(0, node=NODE))
    assert isinstance(note, Note)
    assert "node-ID 93" in note.text
    for identifier in (state_id(NODE), heartbeat_id(NODE), emcy_id(NODE), actuator_echo_id(NODE)):
        assert pe.hear(Frame(identifier, bytes(8))) == []
    assert pe.core.counts["node-ID clash", state_id(NODE)] > 0


def test_ids_is_answered_at_once_when_we_are_asked_and_in_turn_when_all_are() -> None:
    pe = OnePe()
    (answer,) = sent(pe.hear(encode_service(request(0, NODE, message_code=9))), 129)
    message = decode_service(answer)
    assert isinstance(message, tuple)
    assert (message.datum.node_id, message.datum.message_code) == (NODE, 9)
    assert isinstance(read_identification(message), Identification)

    everybody = encode_service(request(0, 0))
    assert pe.hear(everybody) == []
    pe.hear(everybody)
    asked_ns = pe.now_ns
    assert len(sent(pe.pass_time(5 * MS), 129)) == 1
    (at_ns,) = [at_ns for at_ns, action in pe.done if at_ns > asked_ns and sent([action], 129)]
    assert at_ns - asked_ns == (NODE - 92) * MS


def test_other_services_other_nodes_and_malformed_requests_are_not_answered() -> None:
    pe = OnePe()
    for frame in (
        encode_service(request(0, FAR)),
        encode_service(request(10, NODE, data_type=DataType.UCHAR, value=1)),
        Frame(128, b"\x5d"),
        Frame(128, b""),
    ):
        assert pe.hear(frame) == []
    assert sent(pe.pass_time(100 * MS), 129) == []


def test_29_bit_remote_and_error_frames_reach_no_part() -> None:
    pe = OnePe()
    plain = neighbour_state(8)
    for frame in (plain._replace(extended=True), plain._replace(remote=True), plain._replace(error=True)):
        assert pe.hear(frame) == []
    assert pe.core.counts["not a data frame of 11 bits", plain.can_id] == 3
