"""A node's own queue: the most urgent frame first, in order within an identifier, and of bounded length."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.frame import Frame, arbitration_key
from heronry_wire.transmit_queue import TransmitQueue

frames = st.builds(Frame, st.integers(0, 5), st.binary(max_size=1))


def drain(queue: TransmitQueue) -> list[Frame]:
    return [queue.pop() for _ in range(len(queue))]


def test_the_time_of_one_frame_can_be_cut_short_and_what_is_over_goes() -> None:
    queue = TransmitQueue()
    for _ in range(2):
        queue.push(Frame(5, b"twice"))
    queue.push(Frame(4, b"urgent"), 100)
    queue.limit(Frame(5, b"twice"), 200, 0)
    queue.limit(Frame(9, b"is not there"), 200, 0)
    assert queue.first(201) == Frame(5, b"twice")
    assert (len(queue), queue.expired) == (1, 2)
    queue.limit(Frame(5, b"twice"), 300, 201)
    queue.limit(Frame(5, b"twice"), 400, 301)
    assert (len(queue), queue.expired) == (0, 3)


@given(st.lists(frames, max_size=40))
def test_frames_leave_as_the_bus_would_take_them_and_in_order_within_an_identifier(pushed: list[Frame]) -> None:
    queue = TransmitQueue()
    for frame in pushed:
        queue.push(frame)
    assert drain(queue) == sorted(pushed, key=arbitration_key)


@given(st.lists(frames, min_size=1, max_size=40))
def test_the_first_is_the_one_that_leaves_next(pushed: list[Frame]) -> None:
    queue = TransmitQueue()
    for frame in pushed:
        queue.push(frame)
    assert queue.first(0) == queue.pop()


def test_what_does_not_fit_is_the_least_urgent_and_is_counted() -> None:
    queue = TransmitQueue(capacity=2)
    for can_id in (5, 7, 6):
        queue.push(Frame(can_id, b""))
    assert queue.dropped == 1
    assert [frame.can_id for frame in drain(queue)] == [5, 6]


def test_of_equally_urgent_frames_the_newest_does_not_fit() -> None:
    queue = TransmitQueue(capacity=1)
    queue.push(Frame(5, b"old"))
    queue.push(Frame(5, b"new"))
    assert drain(queue) == [Frame(5, b"old")]


def test_what_is_withdrawn_leaves_no_more_and_the_rest_stays_in_order() -> None:
    queue = TransmitQueue()
    for can_id in (7, 5, 7, 6):
        queue.push(Frame(can_id, b""))
    queue.push(Frame(7, b"", extended=True))
    queue.withdraw(frozenset({7, 9}))
    assert [(frame.can_id, frame.extended) for frame in drain(queue)] == [(7, True), (5, False), (6, False)]


def test_what_is_no_longer_of_use_does_not_leave() -> None:
    queue = TransmitQueue()
    queue.push(Frame(5, b""), until_ns=10)
    queue.push(Frame(6, b""), until_ns=20)
    queue.push(Frame(7, b""))
    assert queue.first(10) == Frame(5, b"")
    assert queue.first(11) == Frame(6, b"")
    assert queue.first(1_000) == Frame(7, b"")
    assert queue.expired == 2
    assert drain(queue) == [Frame(7, b"")]
    assert queue.first(0) is None


def test_a_queue_that_holds_data_back_sends_only_more_urgent_frames() -> None:
    queue = TransmitQueue()
    queue.stands_back_until_ns = 10
    queue.push(Frame(300, b""))
    assert (queue.first(9), queue.first(10)) == (None, Frame(300, b""))
    queue.push(Frame(299, b""))
    assert queue.first(9) == queue.pop() == Frame(299, b"")
