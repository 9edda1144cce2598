"""How much of a radio's bandwidth can be used, measured at its gateway without querying the radio.

Two things can be measured at any CAN interface:

    carried     the bit rate that the radio achieves. While a frame of this node is in the controller, the radio
                is never idle. So this bit rate is the bits of the frame, and of all frames heard meanwhile,
                divided by the time for which the frame was in the controller. Where the driver cannot tell this
                time, the carried bit rate is not measured
    delivered   the share of the frames that arrive. Frames are numbered: state frames for each bus, data and
                output echoes for each identifier. A gap in the numbers shows a loss

The usable bit rate is the carried bit rate times the delivered share, both over the last ten heartbeat periods.
If this product over the last two periods is at most half of the product over ten, only the last two periods
count. The reason: if the bandwidth is reduced too late a queue grows, so it is better to reduce it too early.

An *outage* is a time in which the radio carries nothing in either direction: no frame is heard for a period and
a half or more. An outage shows nothing about the bandwidth before and after it. So it counts as only one lost
frame of each sender, and the frame of this node that was stuck in the controller does not count.

The radio is *gone* when no frame has been heard for as many periods as a node on the bus of the radio may miss, plus an
eighth of a period. The manager declares a node down only an eighth of a period later. So the manager hears that the
radio is gone before it would declare the single nodes beyond the radio down, and considers all of them down at once.

The numbers of a sequence are counted anew in two cases:

- They jump: the sender has rebooted.
- The sequence was not heard for ten periods: its frames may have taken another route.

A doubled or late frame does not count as a loss. A forged state frame looks like a loss. It reduces the
bandwidth that the gateway uses over this radio, and has no other effect on the aircraft.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from heronry_wire.canaerospace import read_header
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import PER_MILLE
from heronry_wire.identifiers import Use, classify
from heronry_wire.protocol_times import RADIO_QUICK_PERIODS, RADIO_WINDOW_PERIODS
from heronry_wire.sansio import NEVER_NS
from heronry_wire.state_frames import page_of, sequence_of
from heronry_wire.timing import exact_bits

_QUICK_SHARE = 2  # if the last periods are worse than the whole window by this factor, they count alone
_FEWEST = 8  # frames that must have been due before a share of them means anything
_NS_PER_S = 1_000_000_000
_LONGEST_GAP = 64  # a larger jump of a sequence means that the sequence began anew
_NUMBERED = frozenset((Use.STATE, Use.STANDARD_DATA, Use.ALLOCATED_DATA, Use.ACTUATOR_ECHO))


@dataclass(slots=True)
class _Period:
    """What was counted in one heartbeat period.

    Two numbers are for the time in which a frame of this node was in the controller: the bits that the radio
    carried meanwhile, and the length of this time. Two other numbers are for the frames from beyond the radio:
    how many should have come, and how many came.
    """

    bits: int = 0  # carried while a frame of this node was in the controller
    busy_ns: int = 0  # total time of such frames in the controller
    due: int = 0  # frames from beyond that should have come
    came: int = 0


class _Numbered(NamedTuple):
    """The last received frame of one sequence of numbered frames."""

    sequence: int
    time_ns: int
    outages: int  # number of outages that were over by then


class LinkMeter:
    """Measures the usable bandwidth of one radio, and finds out when the radio is gone."""

    def __init__(self, bitrate: int, period_ns: int, misses: int, now_ns: int) -> None:
        self.gone = False
        self._bitrate = bitrate
        self._patience_ns = misses * period_ns + period_ns // 8
        self._outage_ns, self._stuck_ns = 3 * period_ns // 2, period_ns // 2
        self._window_ns = RADIO_WINDOW_PERIODS * period_ns
        self._heard_ns = now_ns
        self._periods = deque((_Period(),), maxlen=RADIO_WINDOW_PERIODS)
        self._in_flight_bits: int | None = None  # bits heard beside a frame in the controller; None: no such frame
        self._last: dict[tuple[int, int], _Numbered] = {}  # by identifier and sender
        self._outages = 0  # number of outages that are over

    def heard(self, frame: Frame, now_ns: int) -> bool:
        """Note a frame that came from the radio; tells whether the radio was gone until now."""
        was_gone, self.gone = self.gone, False
        if was_gone:
            self._begin_anew()
        if self._in_flight_bits is not None:
            self._in_flight_bits += exact_bits(frame)
        self._outages += now_ns - self._heard_ns >= self._outage_ns
        self._heard_ns = now_ns
        self._number(frame, now_ns)
        return was_gone

    def handed_over(self) -> None:
        """Note that a frame of this node is in the controller from now on."""
        self._in_flight_bits = 0

    def left(self, frame: Frame, took_ns: int) -> None:
        """Note that this frame has left the controller, `took_ns` after it was handed over; 0: the time is unknown."""
        heard_bits, self._in_flight_bits = self._in_flight_bits, None
        if took_ns <= 0 or heard_bits is None:
            return
        if heard_bits or took_ns < self._stuck_ns:
            self._periods[-1].bits += exact_bits(frame) + heard_bits
            self._periods[-1].busy_ns += took_ns

    def stuck(self, took_ns: int) -> None:
        """Note that the frame in the controller has not left it within `took_ns`, and is no longer waited for."""
        heard_bits, self._in_flight_bits = self._in_flight_bits, None
        if heard_bits:
            self._periods[-1].bits += heard_bits
            self._periods[-1].busy_ns += took_ns

    def next_period(self) -> None:
        """Begin to count in a new heartbeat period."""
        self._periods.append(_Period())

    @property
    def gone_ns(self) -> int:
        """Time in ns at which the radio counts as gone if no frame is heard before; NEVER_NS if it is gone already."""
        return NEVER_NS if self.gone else self._heard_ns + self._patience_ns

    def usable(self) -> int:
        """Usable bandwidth of the radio, in thousandths of its bit rate."""
        long = self._carried(RADIO_WINDOW_PERIODS) * self._delivered(RADIO_WINDOW_PERIODS) // PER_MILLE
        quick = self._carried(RADIO_QUICK_PERIODS + 1) * self._delivered(RADIO_QUICK_PERIODS + 1) // PER_MILLE
        return quick if quick * _QUICK_SHARE <= long else long

    def delivered_percent(self) -> int:
        """Percentage of the frames from beyond the radio that have arrived here in the last ten heartbeat periods."""
        return self._delivered(RADIO_WINDOW_PERIODS) // 10

    def _carried(self, periods: int) -> int:
        shares = [
            min(PER_MILLE, PER_MILLE * one.bits * _NS_PER_S // (one.busy_ns * self._bitrate))
            for one in list(self._periods)[-periods:]
            if one.busy_ns
        ]
        return sum(shares) // len(shares) if shares else PER_MILLE

    def _delivered(self, periods: int) -> int:
        recent = list(self._periods)[-periods:]
        due = sum(one.due for one in recent)
        return PER_MILLE if due < _FEWEST else PER_MILLE * sum(one.came for one in recent) // due

    def _number(self, frame: Frame, now_ns: int) -> None:
        """Count a numbered frame as arrived, and count the frames of its sequence that were due.

        Due are the frames numbered after the last one that arrived, up to this frame; after an outage, at most two.
        Nothing is counted for a frame without a number, for a doubled or late frame, and for the first frame of a
        sequence that begins anew.
        """
        use, data = classify(frame.can_id).use, frame.data
        if use not in _NUMBERED or len(data) < 5 or (use is Use.STATE and page_of(data)):
            return
        node, _, _, message_code = read_header(data)
        is_state = use is Use.STATE
        key, sequence = (frame.can_id, 0 if is_state else node), sequence_of(data) if is_state else message_code
        last = self._last.get(key)
        self._last[key] = _Numbered(sequence, now_ns, self._outages)
        if last is None or now_ns - last.time_ns > self._window_ns:
            return
        ahead = (sequence - last.sequence) % 256
        if 0 < ahead <= _LONGEST_GAP:
            self._periods[-1].due += ahead if last.outages == self._outages else min(ahead, 2)
            self._periods[-1].came += 1

    def _begin_anew(self) -> None:
        self._last.clear()
        self._in_flight_bits = None
        self._periods.clear()
        self._periods.append(_Period())
