"""A simulated CAN bus: priority arbitration, exact frame lengths, loss.

A station offers its most urgent frame; while the bus is free the lowest arbitration key of all stations wins, takes the
exact time of its bits (stuffing and intermission included), and is then received by every other station that listens.
Several stations that start at the same instant arbitrate as real ones do: who lost tries again behind the winner.

Faults: `loss` is the probability that a frame is destroyed and has to be sent again by its controller (what CAN does);
`omission` that one receiver alone misses a frame which the others, and the sender, believe delivered (what CAN can
do at the last bit but one: it is not an atomic broadcast); `doubled` that a receiver gets it twice, the other half of
that flaw. A station that is cut off neither sends nor receives. A sender that dies in mid-frame destroys it.

Not modelled: bit errors inside a frame, error counters, bus-off.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from random import Random
from typing import Protocol

from heronry_tools.simulator.clock import LATE, Clock
from heronry_wire.frame import Frame, arbitration_key
from heronry_wire.timing import exact_bits

_ERROR_FRAME_BITS = 31


class Listener(Protocol):
    """Who receives frames."""

    def receive(self, frame: Frame) -> None:
        """Take a frame whose last bit has just been sent."""


@dataclass(slots=True)
class Faults:
    """Probabilities per frame, or per frame and receiver."""

    loss: float = 0.0
    omission: float = 0.0
    doubled: float = 0.0


@dataclass(slots=True, eq=False)
class Station:
    """One node's controller on one bus, with its own queue ordered by priority."""

    name: str
    listener: Callable[[Frame], None]
    queue: list[tuple[int, int, Frame]] = field(default_factory=list)
    connected: bool = True


@dataclass(frozen=True, slots=True)
class Sent:
    """A frame that went over a bus; `end_ns` is the end of its last bit."""

    end_ns: int
    bus: str
    sender: str
    frame: Frame


class SimulatedBus:
    """One CAN segment."""

    def __init__(self, name: str, bitrate: int, clock: Clock, random: Random, faults: Faults) -> None:
        self.name, self.bitrate, self.faults = name, bitrate, faults
        self.busy_bits = 0  # sent so far
        self.taps: list[Callable[[Sent], None]] = []  # who watches; cannot be seen by the stations
        self.intercept: Callable[[Station, Frame], bool] | None = None  # True: this frame is lost to everybody
        self._clock, self._random = clock, random
        self._stations: list[Station] = []
        self._sending: tuple[Station, Frame] | None = None
        self._arbitration_due = False
        self._count = 0

    def join(self, name: str, listener: Callable[[Frame], None]) -> Station:
        """Connect a station."""
        station = Station(name, listener)
        self._stations.append(station)
        return station

    def leave(self, station: Station) -> None:
        """Disconnect a station for good; what it was sending is destroyed."""
        station.connected = False
        station.queue.clear()
        self._stations.remove(station)

    def offer(self, station: Station, frame: Frame) -> None:
        """Queue a frame at a station."""
        self._count += 1
        heappush(station.queue, (arbitration_key(frame), self._count, frame))
        self._arbitrate_soon()

    def _arbitrate_soon(self) -> None:
        if self._sending is None and not self._arbitration_due:
            self._arbitration_due = True
            self._clock.at(self._clock.now_ns, self._arbitrate, LATE)

    def _arbitrate(self) -> None:
        self._arbitration_due = False
        ready = [station for station in self._stations if station.queue and station.connected]
        if self._sending is not None or not ready:
            return
        winner = min(ready, key=lambda station: station.queue[0][:2])
        frame = winner.queue[0][2]
        bits = exact_bits(frame)
        destroyed = self.faults.loss > 0 and self._random.random() < self.faults.loss
        if destroyed:
            bits += _ERROR_FRAME_BITS
        else:
            heappop(winner.queue)
        self.busy_bits += bits
        self._sending = (winner, frame)
        self._clock.at(
            self._clock.now_ns + bits * 1_000_000_000 // self.bitrate, lambda: self._end(winner, frame, destroyed)
        )

    def _end(self, sender: Station, frame: Frame, destroyed: bool) -> None:
        self._sending = None
        self._arbitrate_soon()
        if destroyed or not sender.connected:
            return
        if self.intercept is not None and self.intercept(sender, frame):
            return
        sent = Sent(self._clock.now_ns, self.name, sender.name, frame)
        for tap in self.taps:
            tap(sent)
        for station in tuple(self._stations):
            if station is not sender and station.connected:
                for _ in range(self._copies()):
                    station.listener(frame)

    def _copies(self) -> int:
        faults = self.faults
        if faults.omission > 0 and self._random.random() < faults.omission:
            return 0
        return 2 if faults.doubled > 0 and self._random.random() < faults.doubled else 1
