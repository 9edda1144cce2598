"""Frames that wait for a radio: the most urgent first, the newest of each kind, and a limited number."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.core.forwarding.radio_queue import CAPACITY, DATA_BURST_BITS, MANAGEMENT_BURST_BITS, RadioQueue
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, actuator_echo_id, emcy_id, management_id, state_id
from heronry_wire.timing import worst_bits

S = 1_000_000_000
FRAME_BITS = worst_bits(8)
LEASE, SLICE = management_id(126, Command.LEASE), management_id(126, Command.SLICE)
FOR_EVER = 1000 * S


def queue(rate: int = 10_000, data_per_mille: int = 700) -> RadioQueue:
    return RadioQueue(rate, data_per_mille, 0)


def frame(identifier: int, byte: int = 0) -> Frame:
    return Frame(identifier, bytes((byte,) * 8))


def emptied(waiting: RadioQueue, now_ns: int = 0) -> list[Frame]:
    found = []
    while (first := waiting.take(now_ns)) is not None:
        found.append(first.frame)
    return found


def test_the_most_urgent_goes_first_and_equals_keep_their_order() -> None:
    waiting = queue()
    pushed = [frame(400), frame(SLICE, 1), frame(300), frame(SLICE, 2), frame(LEASE)]
    for one in pushed:
        waiting.push(one, FOR_EVER)
    assert emptied(waiting) == [frame(LEASE), frame(SLICE, 1), frame(SLICE, 2), frame(300), frame(400)]


def test_the_newest_of_a_source_takes_the_place_of_the_oldest() -> None:
    waiting = queue()
    for byte in (1, 2, 3):
        waiting.push(frame(300, byte), FOR_EVER)
        waiting.push(frame(LEASE, byte), FOR_EVER)
    assert emptied(waiting) == [frame(LEASE, 3), frame(300, 3)]
    assert waiting.dropped == 2, "data that were given up are counted"


def test_both_pages_of_a_state_and_each_device_of_an_echo_wait_beside_each_other() -> None:
    waiting = queue()
    pages = [Frame(state_id(94), bytes((page << 6, *bytes(7)))) for page in (0, 1)]
    echoes = [Frame(actuator_echo_id(94), bytes((94, 2, device, 0, *bytes(4)))) for device in (0, 1)]
    for one in (*pages, *echoes, Frame(state_id(93), b"")):
        waiting.push(one, FOR_EVER)
    assert emptied(waiting) == [Frame(state_id(93), b""), *pages, *echoes]


def test_slices_and_emergencies_replace_only_their_own_doubles() -> None:
    waiting = queue()
    pushed = [frame(SLICE, 1), frame(SLICE, 2), frame(emcy_id(94), 1), frame(emcy_id(94), 2)]
    for one in (*pushed, *pushed):
        waiting.push(one, FOR_EVER)
    assert emptied(waiting) == pushed
    assert waiting.dropped == 0


def test_a_full_queue_drops_the_least_urgent_and_counts() -> None:
    waiting = queue()
    for identifier in range(300, 300 + CAPACITY):
        waiting.push(frame(identifier), FOR_EVER)
    waiting.push(frame(LEASE), FOR_EVER)
    waiting.push(frame(1400), FOR_EVER)
    assert (len(waiting), waiting.dropped) == (CAPACITY, 2)
    assert emptied(waiting)[0] == frame(LEASE)


def test_what_would_be_too_old_behind_the_frame_under_way_is_dropped_and_counted() -> None:
    waiting = queue(rate=10_000)
    under_way_ns = FRAME_BITS * S // 10_000
    waiting.push(frame(300), under_way_ns + 10)
    waiting.push(frame(301), under_way_ns + 11)
    assert emptied(waiting, 11) == [frame(301)]
    assert waiting.dropped == 1


def test_what_is_withdrawn_does_not_go() -> None:
    waiting = queue()
    waiting.push(frame(300), FOR_EVER)
    waiting.push(frame(301), FOR_EVER)
    waiting.withdraw(frozenset({300}))
    assert emptied(waiting) == [frame(301)]


def test_data_leave_to_management_what_is_reserved_for_it() -> None:
    waiting = queue(rate=10_000, data_per_mille=700)
    for identifier in range(300, 340):
        waiting.push(frame(identifier), FOR_EVER)
    assert len(emptied(waiting)) == DATA_BURST_BITS // FRAME_BITS
    waiting.push(frame(LEASE), FOR_EVER)
    assert emptied(waiting) == [frame(LEASE)], "management is not held up by data"
    due_ns = waiting.next_ns()
    assert due_ns is not None
    assert waiting.take(due_ns - 1) is None
    assert waiting.take(due_ns) is not None
    assert due_ns == -(-FRAME_BITS * S // 7_000)


def test_an_empty_queue_needs_no_time_and_what_may_go_needs_none() -> None:
    waiting = queue()
    assert waiting.next_ns() is None
    waiting.push(frame(LEASE), FOR_EVER)
    assert waiting.next_ns() == 0


@given(
    rate=st.integers(1_000, 1_000_000),
    steps=st.lists(
        st.tuples(st.integers(0, S // 10), st.sampled_from((LEASE, SLICE, 300, 301, 302)), st.integers(0, 255)),
        max_size=200,
    ),
)
def test_no_more_goes_than_the_bandwidth_and_one_burst(rate: int, steps: list[tuple[int, int, int]]) -> None:
    waiting, now_ns, data_bits, other_bits = queue(rate), 0, 0, 0
    for wait_ns, identifier, byte in steps:
        now_ns += wait_ns
        waiting.push(frame(identifier, byte), FOR_EVER)
        for gone in emptied(waiting, now_ns):
            data_bits += FRAME_BITS * (gone.can_id >= 300)
            other_bits += FRAME_BITS * (gone.can_id < 300)
        assert len(waiting) <= CAPACITY
    assert data_bits <= DATA_BURST_BITS + rate * 7 // 10 * now_ns / S + 1
    assert other_bits <= MANAGEMENT_BURST_BITS + (rate - rate * 7 // 10) * now_ns / S + 1
