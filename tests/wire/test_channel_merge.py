"""Two channels as one bus: which frames are taken when the channels lose, delay, or bring them again much later."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.channel_merge import ChannelMerge, window_ns
from heronry_wire.frame import Frame

MS = 1_000_000
BEAT_NS = 20 * MS
WINDOW_NS = window_ns(BEAT_NS)
LEASE, OTHER = Frame(200, b"lease"), Frame(300, b"datum")


def taken(*brought: tuple[float, int, Frame]) -> list[bool]:
    """Which of these frames of the channels are taken, each with its time in milliseconds."""
    merge = ChannelMerge(BEAT_NS)
    return [merge.take(channel, frame, round(at_ms * MS)) for at_ms, channel, frame in brought]


def test_the_first_copy_is_taken_whichever_channel_brings_it() -> None:
    assert taken((0, 0, LEASE), (0.1, 1, LEASE)) == [True, False]
    assert taken((0, 1, LEASE), (9.9, 0, LEASE)) == [True, False]


def test_two_equal_frames_are_two_in_whatever_order_their_copies_come() -> None:
    assert taken((0, 0, LEASE), (1, 0, LEASE), (2, 1, LEASE), (3, 1, LEASE)) == [True, True, False, False]
    assert taken((0, 0, LEASE), (1, 1, LEASE), (2, 1, LEASE), (3, 0, LEASE)) == [True, False, True, False]


def test_copies_are_told_apart_by_identifier_and_bytes() -> None:
    assert taken((0, 0, LEASE), (0, 1, LEASE._replace(data=b"lesae")), (0, 1, LEASE._replace(can_id=201))) == [True] * 3
    assert taken((0, 0, LEASE), (0, 1, LEASE._replace(extended=True))) == [True] * 2


def test_what_is_repeated_in_the_next_period_is_new() -> None:
    assert taken((0, 0, LEASE), (20, 0, LEASE), (20, 1, LEASE), (40, 1, LEASE), (40, 0, LEASE)) == [
        True,
        True,
        False,
        True,
        False,
    ]


def test_with_one_channel_gone_nothing_changes() -> None:
    one_wire = [(20 * beat, 0, LEASE) for beat in range(10)]
    assert all(taken(*one_wire))
    the_other_from_then_on = [(200 + 20 * beat, 1, LEASE) for beat in range(10)]
    in_step = [(0, 0, LEASE), (0, 1, LEASE)]
    assert taken(*in_step, *((at_ms, 1, LEASE) for at_ms, _, _ in the_other_from_then_on))[2:] == [True] * 10


def test_what_waited_on_a_channel_that_comes_back_is_withheld_and_the_channel_is_in_step_with_the_next_pair() -> None:
    """A state that is a second old would look like a restart."""
    old, new = Frame(260, b"old"), Frame(260, b"new")
    away = [(20.0 * beat, 0, new) for beat in range(50)]
    returns = [(1000, 0, new), (1003, 1, old), (1004, 1, new), (1020, 1, new), (1020.1, 0, new)]
    assert taken((0, 1, old), (0, 0, old), *away, *returns)[-5:] == [True, False, False, True, False]


def test_what_was_withheld_is_taken_when_the_other_channel_brings_it_too() -> None:
    missed, late = (0, 0, LEASE), [(20, 1, LEASE), (20.1, 0, LEASE)]
    assert taken(missed, (15, 0, OTHER), *late) == [True, True, False, True]


def test_a_channel_that_is_behind_leads_once_the_other_one_has_failed() -> None:
    missed_by_the_second = (0, 0, LEASE)
    then_the_first_fails = [(20, 1, LEASE), (40, 1, LEASE), (60, 1, LEASE)]
    assert taken(missed_by_the_second, *then_the_first_fails) == [True, False, True, True]


def test_a_wire_of_one_sender_is_its_own_affair() -> None:
    merge = ChannelMerge(BEAT_NS)
    for beat in range(10):
        for channel in (0, 1):
            merge.take(channel, OTHER, beat * BEAT_NS)
        merge.take(0, LEASE, beat * BEAT_NS)
    assert not merge.take(1, LEASE._replace(data=b"stale"), 10 * BEAT_NS - 1)
    assert merge.take(1, OTHER, 10 * BEAT_NS - 1)
    assert merge.take(0, Frame(1, b""), 12 * BEAT_NS)
    assert merge.stale == 1


def test_stamps_that_are_a_little_out_of_order_change_nothing() -> None:
    """A process that slept empties one socket after the other."""
    first = [(beat, 0, Frame(400, bytes([beat]))) for beat in range(8)]
    second = [(beat, 1, frame) for beat, _, frame in first]
    assert taken(*first, *second) == [True] * 8 + [False] * 8


frames = st.builds(Frame, st.integers(0, 2), st.sampled_from((b"a", b"b")))
arrivals = st.lists(st.tuples(st.integers(0, 1), frames, st.integers(0, 3 * MS)), max_size=40)


@given(arrivals)
def test_within_a_window_as_many_are_taken_as_the_better_channel_has_brought(
    brought: list[tuple[int, Frame, int]],
) -> None:
    merge, now_ns = ChannelMerge(1000 * BEAT_NS), 0
    of_channel: tuple[Counter[Frame], Counter[Frame]] = (Counter(), Counter())
    seen: Counter[Frame] = Counter()
    for channel, frame, later_ns in brought:
        now_ns += later_ns
        of_channel[channel][frame] += 1
        seen[frame] += merge.take(channel, frame, now_ns)
        assert seen == of_channel[0] | of_channel[1]


@given(st.lists(st.tuples(frames, st.integers(0, 60 * MS)), max_size=60), st.integers(0, 1))
def test_what_one_channel_brings_alone_is_taken_all_of_it(sent: list[tuple[Frame, int]], channel: int) -> None:
    merge, now_ns = ChannelMerge(BEAT_NS), 0
    for frame, later_ns in sent:
        now_ns += later_ns
        assert merge.take(channel, frame, now_ns)
    assert (merge.copies, merge.stale) == (0, 0)


@given(
    st.lists(st.tuples(frames, st.integers(BEAT_NS, 3 * BEAT_NS), st.integers(0, WINDOW_NS)), max_size=60),
    st.integers(0, 1),
)
def test_two_channels_that_bring_everything_are_one(sent: list[tuple[Frame, int, int]], first: int) -> None:
    merge, now_ns = ChannelMerge(BEAT_NS), 0
    for frame, later_ns, lag_ns in sent:
        now_ns += later_ns
        assert merge.take(first, frame, now_ns)
        assert not merge.take(1 - first, frame, now_ns + lag_ns)
    assert merge.copies == len(sent)


@given(arrivals, st.integers(1, 30 * MS))
def test_it_remembers_nothing_that_is_over(brought: list[tuple[int, Frame, int]], pace_ns: int) -> None:
    """In a flight of any length only the frames of one window are kept."""
    merge, now_ns = ChannelMerge(BEAT_NS), 0
    for channel, frame, later_ns in brought:
        now_ns += later_ns * pace_ns // MS
        merge.take(channel, frame, now_ns)
    merge.take(0, Frame(9, b""), now_ns + WINDOW_NS + 1)
    assert (len(merge._order), len(merge._alone)) == (1, 1)
