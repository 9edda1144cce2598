"""The line against a simple calculation of the same rules, for any offers and any lateness of the caller."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_tools.runtime.softbus.line import NS_PER_S, Line, Transmission
from heronry_tools.runtime.softbus.protocol import BusFrame
from heronry_wire.frame import EXTENDED_MASK, STANDARD_MASK, Frame, arbitration_key
from heronry_wire.timing import exact_bits

BITRATE = 1_000_000

frames = st.one_of(
    st.builds(Frame, st.integers(0, STANDARD_MASK), st.binary(max_size=8)),
    st.builds(Frame, st.integers(0, EXTENDED_MASK), st.binary(max_size=8), st.just(True)),
)
offers = st.builds(lambda frame, time_ns: BusFrame(frame, len(frame.data), time_ns), frames, st.integers(0, 1_000_000))


def reckon(offered: list[BusFrame]) -> list[Transmission]:
    """Send one frame of each client by the rules, all offers being known from the beginning."""
    waiting = dict(enumerate(offered))
    sent: list[Transmission] = []
    idle_since_ns = 0
    while waiting:
        start_ns = max(idle_since_ns, min(each.time_ns for each in waiting.values()))
        contending = [number for number in waiting if waiting[number].time_ns <= start_ns]
        winner = min(contending, key=lambda n: (arbitration_key(waiting[n].frame), waiting[n].time_ns, n))
        idle_since_ns = start_ns + exact_bits(waiting[winner].frame) * NS_PER_S // BITRATE
        sent.append(Transmission(winner, waiting.pop(winner), start_ns, idle_since_ns))
    return sent


def look(line: Line, now_ns: int) -> list[Transmission]:
    return list(iter(lambda: line.advance(now_ns), None))


@given(st.lists(offers, max_size=12), st.lists(st.integers(0, 3_000_000), max_size=12))
def test_however_late_one_looks_the_same_frames_were_sent_at_the_same_times(
    offered: list[BusFrame], looks_ns: list[int]
) -> None:
    line = Line(BITRATE)
    sent: list[Transmission] = []
    handed_in = -1
    for now_ns in sorted([*looks_ns, NS_PER_S]):
        for client, offer in enumerate(offered):
            if handed_in < offer.time_ns <= now_ns:
                line.offer(client, offer)
        handed_in = now_ns
        sent += look(line, now_ns)
    assert sent == reckon(offered)
    assert line.frames == len(sent)
    assert line.busy_ns == sum(each.end_ns - each.start_ns for each in sent)


@given(st.lists(offers, max_size=12))
def test_looking_at_each_deadline_misses_nothing_and_comes_to_an_end(offered: list[BusFrame]) -> None:
    line = Line(BITRATE)
    for client, offer in enumerate(offered):
        line.offer(client, offer)
    sent: list[Transmission] = []
    deadlines_ns: list[int] = []
    while (deadline_ns := line.next_deadline_ns()) is not None:
        deadlines_ns.append(deadline_ns)
        sent += look(line, deadline_ns)
    assert sent == reckon(offered)
    assert deadlines_ns == sorted(deadlines_ns)
    assert len(deadlines_ns) <= 2 * len(offered) + 1


def test_what_is_withdrawn_is_not_sent_and_what_is_on_the_air_is() -> None:
    line = Line(BITRATE)
    on_air, waiting = (BusFrame(Frame(can_id, b""), 0, 0) for can_id in (1, 2))
    line.offer(1, on_air)
    line.offer(2, waiting)
    assert line.advance(0) is None
    line.withdraw(1)
    line.withdraw(2)
    assert [each.client for each in look(line, NS_PER_S)] == [1]
    assert line.next_deadline_ns() is None


def test_frame_times_are_rounded_up_to_whole_nanoseconds() -> None:
    frame = BusFrame(Frame(0x7FF, b""), 0, 0)
    assert exact_bits(frame.frame) == 50
    assert Line(1_000_000).frame_ns(frame) == 50_000
    assert Line(83_333).frame_ns(frame) == 600_003


def test_on_a_bus_that_is_slowed_down_frames_take_longer() -> None:
    sent = BusFrame(Frame(0x123, bytes(8)), 8, 0)
    line = Line(BITRATE)
    usual_ns = line.frame_ns(sent)
    line.slowdown = 10
    assert line.frame_ns(sent) == 10 * usual_ns
