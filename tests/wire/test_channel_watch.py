"""Which channel is lost, from the frames that both channels carry."""

import pytest

from heronry_wire.channel_watch import ChannelWatch

MS = 1_000_000
BEAT_NS = 20 * MS
NONE: frozenset[int] = frozenset()


class Bus:
    """A bus of some nodes that send in every period."""

    def __init__(self) -> None:
        self.watch = ChannelWatch(BEAT_NS, 3, 0)
        self.now_ns = 0

    def beats(self, count: int, *, heard: tuple[int, ...] = (0, 1), left: tuple[int, ...] = (0, 1)) -> frozenset[int]:
        """Let periods pass in which these channels give these signs; gives the channels that are lost then."""
        for _ in range(count):
            self.now_ns += BEAT_NS
            for channel in heard:
                self.watch.heard(channel, self.now_ns)
            for channel in left:
                self.watch.left(channel, self.now_ns)
        return self.watch.lost(self.now_ns)


@pytest.mark.parametrize("channel", [0, 1])
def test_a_channel_that_is_silent_for_more_than_three_periods_is_lost(channel: int) -> None:
    bus, other = Bus(), (1 - channel,)
    assert bus.beats(5) == NONE
    assert bus.beats(3, heard=other, left=other) == NONE
    assert bus.beats(1, heard=other, left=other) == {channel + 1}
    assert bus.beats(100, heard=other, left=other) == {channel + 1}


def test_a_wire_that_is_broken_in_one_direction_is_lost_as_well() -> None:
    for signs in ({"heard": (0,)}, {"left": (0,)}):
        assert Bus().beats(4, **signs) == {2}


def test_a_wire_broken_this_way_and_the_other_one_that_way_are_both_lost() -> None:
    assert Bus().beats(4, heard=(0,), left=(1,)) == {1, 2}


def test_it_is_back_when_it_has_kept_up_for_ten_periods() -> None:
    bus = Bus()
    bus.beats(4, heard=(0,), left=(0,))
    assert bus.beats(10) == {2}
    assert bus.beats(1) == NONE


def test_what_flaps_stays_lost() -> None:
    bus = Bus()
    for _ in range(5):
        assert bus.beats(4, heard=(0,), left=(0,)) == {2}
        assert bus.beats(6) == {2}


def test_no_channel_is_lost_on_a_silent_bus_or_after_a_pause() -> None:
    bus = Bus()
    assert bus.beats(100, heard=(), left=()) == NONE
    assert bus.beats(1) == NONE


def test_when_the_second_one_goes_as_well_it_is_as_it_was() -> None:
    bus = Bus()
    bus.beats(4, heard=(0,), left=(0,))
    assert bus.beats(50, heard=(), left=()) == {2}


def test_an_old_stamp_takes_nothing_back() -> None:
    watch = ChannelWatch(BEAT_NS, 3, 0)
    watch.heard(0, 4 * BEAT_NS)
    watch.heard(0, BEAT_NS)
    assert watch.lost(4 * BEAT_NS) == {2}
