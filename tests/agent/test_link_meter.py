"""How much of a radio's bandwidth can be used, as its gateway measures it."""

from random import Random

import pytest

from heronry_agent.core.forwarding.link_meter import LinkMeter
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.frame import Frame
from heronry_wire.identifiers import state_id
from heronry_wire.protocol_times import RADIO_WINDOW_PERIODS
from heronry_wire.sansio import NEVER_NS
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from heronry_wire.timing import exact_bits

MS = 1_000_000
PERIOD_NS, MISSES, BITRATE = 200 * MS, 4, 112_500
OURS = Frame(200, bytes(8))
OURS_NS = exact_bits(OURS) * 1_000_000_000 // BITRATE


def meter() -> LinkMeter:
    return LinkMeter(BITRATE, PERIOD_NS, MISSES, 0)


def state(sequence: int, node: int = 94) -> Frame:
    page = StatePage0(PeState.ACTIVE, PeFlags(0), 1, 5, sequence % 256, 7)
    return Frame(state_id(node), page.encode())


def datum(code: int) -> Frame:
    return encode_data(330, Datum(94, DataType.FLOAT, 0x11, code % 256, 1.0))


def carry(one: LinkMeter, took_ns: int, heard: tuple[Frame, ...] = (), now_ns: int = 0) -> None:
    one.handed_over()
    for frame in heard:
        one.heard(frame, now_ns)
    one.left(OURS, took_ns)


def test_a_radio_of_which_nothing_is_known_is_taken_for_whole() -> None:
    assert (meter().usable(), meter().delivered_percent()) == (1000, 100)


@pytest.mark.parametrize(("slower", "usable"), [(1, 1000), (2, 500), (10, 100)])
def test_frames_that_take_longer_are_a_slower_radio(slower: int, usable: int) -> None:
    one = meter()
    carry(one, slower * OURS_NS)
    assert one.usable() == pytest.approx(usable, abs=1)


def test_waiting_for_others_is_not_slowness() -> None:
    one = meter()
    others = tuple(datum(code) for code in range(3))
    carry(one, OURS_NS + sum(exact_bits(frame) for frame in others) * 1_000_000_000 // BITRATE, others)
    assert one.usable() == pytest.approx(1000, abs=1)


def test_a_driver_that_cannot_say_how_long_it_took_says_nothing() -> None:
    one = meter()
    carry(one, 0)
    one.left(OURS, 5)
    assert one.usable() == 1000


def test_a_gateway_that_cannot_send_and_hears_has_only_what_it_hears() -> None:
    one = meter()
    one.handed_over()
    one.heard(datum(0), MS)
    one.stuck(PERIOD_NS)
    assert 0 < one.usable() < 20


def test_a_frame_that_is_stuck_in_an_outage_says_nothing() -> None:
    one = meter()
    one.handed_over()
    one.stuck(PERIOD_NS)
    carry(one, PERIOD_NS // 2)
    assert one.usable() == 1000


def test_gaps_in_the_sequences_are_losses() -> None:
    random, one = Random(1), meter()
    for number in range(200):
        now_ns = number * PERIOD_NS // 20
        for frame in (state(number), datum(number)):
            if random.random() >= 0.3:
                one.heard(frame, now_ns)
    assert one.usable() == pytest.approx(700, abs=60)
    assert one.delivered_percent() == one.usable() // 10


def test_a_few_frames_are_not_enough_to_tell() -> None:
    one = meter()
    one.heard(state(0), 0)
    one.heard(state(3), MS)
    assert one.usable() == 1000


def test_what_is_doubled_late_restarted_or_of_page_1_is_no_loss() -> None:
    one = meter()
    page_1 = StatePage1(PeState.ACTIVE, PeFlags(0), 0, 0, Reason.NONE, 0)
    for frame in (state(5), state(5), state(4), state(5), Frame(state_id(94), page_1.encode()), datum(0), datum(200)):
        one.heard(frame, 0)
    for number in range(200, 220):
        one.heard(datum(number), 0)
    one.heard(Frame(state_id(94), b"\0"), 0)
    one.heard(Frame(128, bytes(8)), 0)
    assert one.delivered_percent() == 100


@pytest.mark.parametrize(("away", "percent"), [(range(10, 31), 100), (range(10, 20), 100 * 86 // 106)])
def test_what_led_elsewhere_for_as_long_as_is_looked_back_on_begins_anew(away: range, percent: int) -> None:
    """The states go on, and so do the numbers of the datum, on the other way."""
    one = meter()
    for number in range(31 + RADIO_WINDOW_PERIODS // 2):
        one.heard(state(number), number * PERIOD_NS // 2)
        if number not in away:
            one.heard(datum(2 * number), number * PERIOD_NS // 2)
            one.heard(datum(2 * number + 1), number * PERIOD_NS // 2)
    assert one.delivered_percent() == percent


def test_an_outage_counts_as_one_frame_of_each_sender() -> None:
    one = meter()
    for number in range(20):
        one.heard(state(number), number)
        one.heard(datum(number), number)
    one.heard(state(29), 3 * PERIOD_NS)
    one.heard(datum(60), 3 * PERIOD_NS + MS)
    assert one.delivered_percent() == 100 * 42 // 44


def test_the_last_two_periods_count_alone_where_they_are_much_worse() -> None:
    one = meter()
    for _ in range(RADIO_WINDOW_PERIODS):
        carry(one, OURS_NS)
        one.next_period()
    carry(one, 2 * OURS_NS)
    one.next_period()
    carry(one, 2 * OURS_NS)
    one.next_period()
    assert one.usable() > 800, "half as fast for a moment: not yet"
    for _ in range(2):
        carry(one, 20 * OURS_NS)
        one.next_period()
    assert one.usable() == pytest.approx(50, abs=2)


def test_old_periods_are_forgotten() -> None:
    one = meter()
    carry(one, 10 * OURS_NS)
    for _ in range(RADIO_WINDOW_PERIODS):
        one.next_period()
        carry(one, OURS_NS)
    assert one.usable() == 1000


def test_a_radio_is_gone_when_nothing_was_heard_and_begins_anew_when_something_is() -> None:
    one = meter()
    one.heard(state(0), 5 * MS)
    assert one.gone_ns == 5 * MS + MISSES * PERIOD_NS + PERIOD_NS // 8
    carry(one, 10 * OURS_NS)
    one.gone = True
    assert one.gone_ns == NEVER_NS
    one.handed_over()
    assert one.heard(state(77), 5000 * MS)
    one.left(OURS, 800 * MS)
    assert (one.gone, one.usable()) == (False, 1000)
