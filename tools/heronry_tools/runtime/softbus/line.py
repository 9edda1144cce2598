"""The line: which of the offered frames is on the bus, and from when to when.

States: idle, or one frame on the air.

As in CAN arbitration, when the bus becomes idle the offered frame with the highest priority gets the bus. The bus is
then busy for the exact length of that frame (stuff bits, intermission) at the bit rate.

All times are those of the bus, not of the hub. A frame starts at max(end of the previous frame, time of its offer) and
ends one frame time later. If the hub wakes late, it calls `advance` late and delivers frames late. But delays do not
add up, and the bandwidth stays the same: the next frame counts as started in time.

The caller guarantees that it has handed in every offer made before `now_ns` when it calls `advance(now_ns)`. No frame
is started later than `now_ns`. So no offer that comes afterwards could have won against a frame that was started.

A client may have several frames offered, which compete like those of several clients; those of one identifier go in the
order of their offers. If a client leaves, its offered frames are withdrawn. Its frame on the air is completed, as on a
real bus, where the controller completes the frame although its processor has died. If two clients offer one identifier,
the client that offered first wins; on a real bus this is an error if their data differ.
"""

from functools import lru_cache
from typing import NamedTuple

from heronry_tools.runtime.softbus.protocol import BusFrame
from heronry_wire.frame import arbitration_key
from heronry_wire.frame_port import Haste
from heronry_wire.timing import exact_bits

NS_PER_S = 1_000_000_000
_bits_of = lru_cache(maxsize=8192)(exact_bits)  # most frames repeat an earlier one


class Transmission(NamedTuple):
    """One frame that a client has sent on the bus, with its begin and its end in ns of CLOCK_MONOTONIC."""

    client: int
    sent: BusFrame
    start_ns: int
    end_ns: int


class Line:
    """One bus at `bitrate` (bit/s). Clients are numbers, times are ns of CLOCK_MONOTONIC."""

    def __init__(self, bitrate: int) -> None:
        self.bitrate = bitrate
        self.slowdown = 1  # how many times longer bits take, as on a weak radio
        self.frames = 0
        self.busy_ns = 0
        self._idle_since_ns = 0
        self._on_air: Transmission | None = None
        self._offers: dict[int, tuple[int, BusFrame, int]] = {}  # arbitration key, frame, client; by number
        self._last_number = 0

    def offer(self, client: int, offered: BusFrame) -> None:
        """Let a client contend for the bus with a frame, from `offered.time_ns` on."""
        self._last_number += 1
        self._offers[self._last_number] = (arbitration_key(offered.frame), offered, client)

    def withdraw(self, client: int, identifiers: frozenset[int] | None = None) -> list[BusFrame]:
        """Withdraw what a client has offered; gives these frames.

        identifiers: only 11-bit frames with these; None: all frames, because the client has left.
        """
        found = [
            number
            for number, (_, offered, one) in self._offers.items()
            if one == client
            and (identifiers is None or (offered.frame.can_id in identifiers and not offered.frame.extended))
        ]
        return [self._offers.pop(number)[1] for number in found]

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which `advance` must be called next; None if no frame is on the air or offered."""
        if self._on_air is not None:
            return self._on_air.end_ns
        return self._next_start_ns() if self._offers else None

    def hurries(self) -> bool:
        """Tell whether a frame on the air or offered is not patient."""
        on_air = self._on_air
        return (on_air is not None and on_air.sent.haste is not Haste.PATIENT) or any(
            offered.haste is not Haste.PATIENT for _, offered, _ in self._offers.values()
        )

    def on_air_until_ns(self) -> int | None:
        """Return the end (ns) of the frame on the air; None: no frame is known to be on the air."""
        return None if self._on_air is None else self._on_air.end_ns

    def hurry(self, client: int) -> None:
        """Make the patient frames of a client prompt that have not left yet."""
        on_air = self._on_air
        if on_air is not None and on_air.client == client:
            self._on_air = on_air._replace(sent=on_air.sent._replace(haste=Haste.PROMPT))
        for number, (key, offered, one) in self._offers.items():
            if one == client:
                self._offers[number] = key, offered._replace(haste=Haste.PROMPT), one

    def advance(self, now_ns: int) -> Transmission | None:
        """Return the next frame whose transmission has ended by `now_ns`; None if there is none.

        The caller repeats the call until the result is None.
        """
        if self._on_air is None and self._offers:
            start_ns = self._next_start_ns()
            if start_ns <= now_ns:
                self._on_air = self._arbitrate(start_ns)
        gone = self._on_air
        if gone is None or gone.end_ns > now_ns:
            return None
        self._on_air = None
        self._idle_since_ns = gone.end_ns
        self.frames += 1
        self.busy_ns += gone.end_ns - gone.start_ns
        return gone

    def frame_ns(self, sent: BusFrame) -> int:
        """Return the time for which a frame occupies the bus, in ns, rounded up."""
        return -(-_bits_of(sent.frame) * self.slowdown * NS_PER_S // self.bitrate)

    def _next_start_ns(self) -> int:
        return max(self._idle_since_ns, min(offered.time_ns for _, offered, _ in self._offers.values()))

    def _arbitrate(self, start_ns: int) -> Transmission:
        _, _, winner = min(
            (key, offered.time_ns, number)
            for number, (key, offered, _) in self._offers.items()
            if offered.time_ns <= start_ns
        )
        _, sent, client = self._offers.pop(winner)
        return Transmission(client, sent, start_ns, start_ns + self.frame_ns(sent))
