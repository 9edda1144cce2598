"""The line: which of the offered frames is on the bus, and from when to when.

States: idle, or one frame on the air. A client has at most one frame offered or on the air.

As in CAN arbitration, when the bus becomes idle the offered frame with the highest priority gets the bus. The bus is
then busy for the exact length of that frame (stuff bits, intermission) at the bit rate.

All times are those of the bus, not of the hub. A frame starts at max(end of the previous frame, time of its offer) and
ends one frame time later. If the hub wakes late, it calls `advance` late and delivers frames late. But delays do not
add up, and the bandwidth stays the same: the next frame counts as started in time.

The caller guarantees that it has handed in every offer made before `now_ns` when it calls `advance(now_ns)`. No frame
is started later than `now_ns`. So no offer that comes afterwards could have won against a frame that was started.

If a client leaves, its offered frame is withdrawn. Its frame on the air is completed, as on a real bus, where the
controller completes the frame although its processor has died. If two clients offer one identifier, the client that
offered first wins; on a real bus this is an error if their data differ.
"""

from typing import NamedTuple

from heronry_tools.runtime.softbus.protocol import BusFrame
from heronry_wire.frame import arbitration_key
from heronry_wire.timing import exact_bits

NS_PER_S = 1_000_000_000


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
        self._offers: dict[int, tuple[int, BusFrame]] = {}

    def offer(self, client: int, offered: BusFrame) -> None:
        """Let a client contend for the bus with a frame, from `offered.time_ns` on.

        The client may offer its next frame when this one has left the bus.
        """
        self._offers[client] = (arbitration_key(offered.frame), offered)

    def withdraw(self, client: int) -> None:
        """Withdraw the frame that a client has offered, if any, because the client has left."""
        self._offers.pop(client, None)

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which `advance` must be called next; None if no frame is on the air or offered."""
        if self._on_air is not None:
            return self._on_air.end_ns
        return self._next_start_ns() if self._offers else None

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
        """Give the time for which a frame occupies the bus, in ns, rounded up."""
        return -(-exact_bits(sent.frame) * self.slowdown * NS_PER_S // self.bitrate)

    def _next_start_ns(self) -> int:
        return max(self._idle_since_ns, min(offered.time_ns for _, offered in self._offers.values()))

    def _arbitrate(self, start_ns: int) -> Transmission:
        _, _, winner = min(
            (key, offered.time_ns, client)
            for client, (key, offered) in self._offers.items()
            if offered.time_ns <= start_ns
        )
        _, sent = self._offers.pop(winner)
        return Transmission(winner, sent, start_ns, start_ns + self.frame_ns(sent))
