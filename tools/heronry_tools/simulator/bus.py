"""A simulated CAN bus: priority arbitration, exact frame lengths, loss.

Every station hands over its frames by priority, so the frame that wins the bus is the most urgent of all that wait
anywhere: one queue serves the whole bus. While the bus is free the winner is sent, takes the exact time of its bits
(stuffing and intermission included), and is then received by every other station. What is offered at the very instant
at which the bus falls free takes part in the arbitration of that instant.

Faults: `loss` is the probability that a frame is destroyed and has to be sent again by its controller (what CAN does);
`omission` that one receiver alone misses a frame which the others, and the sender, believe delivered (what CAN can
do at the last bit but one: it is not an atomic broadcast); `doubled` that a receiver gets it twice, the other half of
that flaw. `tamper` decides the same for one frame at a time. A station that is cut off neither sends nor receives, and
sends later what it was given meanwhile, as far as that has not expired; one that is deaf sends and does not receive. A
station that leaves while it sends destroys that frame.

Two stations that have the same identifier waiting when the bus falls free would destroy each other's frames: that is
noted in `clashes`, and the one that was offered first is sent.

Not modelled: bit errors inside a frame, error counters, bus-off.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from random import Random
from typing import NamedTuple

from heronry_tools.simulator.clock import LATE, Clock
from heronry_wire.frame import Frame, arbitration_key
from heronry_wire.sansio import Received
from heronry_wire.timing import exact_bits

_ERROR_FRAME_BITS = 31
_NS_PER_S = 1_000_000_000
FOR_EVER_NS = 1 << 63


@dataclass(frozen=True, slots=True)
class Faults:
    """Probabilities per frame, or per frame and receiver."""

    loss: float = 0.0
    omission: float = 0.0
    doubled: float = 0.0


class Sent(NamedTuple):
    """A frame that went over a bus; `end_ns` is the end of its last bit."""

    end_ns: int
    bus: str
    sender: str
    frame: Frame


class Clash(NamedTuple):
    """Two stations had the same identifier waiting for the same arbitration."""

    t_ns: int
    bus: str
    can_id: int
    stations: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Tampering:
    """What becomes of one frame: how many copies are received, by one station alone or (None) by everybody."""

    copies: int
    receiver: str | None = None


@dataclass(slots=True, eq=False)
class Station:
    """One node's controller on one bus."""

    name: str
    port: int  # the bus, as this node counts its own
    listener: Callable[[Received], None]
    present: bool = True
    cut_off: bool = False
    deaf: bool = False
    stranded: list[tuple[Frame, int]] = field(default_factory=list)  # while cut off: frames, and until when they serve


class _Waiting(NamedTuple):
    """A frame on its way: ordered by arbitration key, then as offered."""

    key: int
    offer: int
    station: Station
    frame: Frame
    until_ns: int


class SimulatedBus:
    """One CAN segment."""

    def __init__(self, name: str, bitrate: int, clock: Clock, random: Random, faults: Faults) -> None:
        """`random` is drawn from only where `faults` asks for it."""
        self.name, self.bitrate, self.faults = name, bitrate, faults
        self.busy_bits = 0  # sent so far
        self.frames = 0
        self.clashes: list[Clash] = []
        self.taps: list[Callable[[Sent], None]] = []  # who watches; the stations cannot see them
        self.tamper: Callable[[Sent], Tampering | None] | None = None
        self._clock, self._random = clock, random
        self._stations: list[Station] = []
        self._waiting: list[_Waiting] = []
        self._busy = False
        self._arbitration_due = False
        self._offers = 0

    def join(self, name: str, port: int, listener: Callable[[Received], None]) -> Station:
        """Connect a station."""
        station = Station(name, port, listener)
        self._stations.append(station)
        return station

    def leave(self, station: Station) -> None:
        """Disconnect a station for good; what it had to say is lost."""
        station.present = False
        self._stations.remove(station)

    def cut(self, station: Station) -> None:
        """Break the wire of a station."""
        station.cut_off = True

    def mend(self, station: Station) -> None:
        """Mend the wire of a station."""
        station.cut_off = False
        stranded, station.stranded = station.stranded, []
        for frame, until_ns in stranded:
            self.offer(station, frame, until_ns)

    def offer(self, station: Station, frame: Frame, until_ns: int = FOR_EVER_NS) -> None:
        """Queue a frame at a station; one that cannot start by `until_ns` is not sent."""
        if not station.present:
            return
        self._offers += 1
        heappush(self._waiting, _Waiting(arbitration_key(frame), self._offers, station, frame, until_ns))
        if not self._busy and not self._arbitration_due:
            self._arbitrate_soon()

    def withdraw(self, station: Station, identifiers: frozenset[int]) -> None:
        """Take back what waits at a station under these identifiers; what is being sent is sent."""
        self._waiting = [w for w in self._waiting if w.station is not station or w.frame.can_id not in identifiers]
        heapify(self._waiting)
        station.stranded = [one for one in station.stranded if one[0].can_id not in identifiers]

    def _arbitrate_soon(self) -> None:
        self._arbitration_due = True
        self._clock.at(self._clock.now_ns, self._arbitrate, LATE)

    def _arbitrate(self) -> None:
        self._arbitration_due = False
        head = self._head()
        if head is None:
            return
        heappop(self._waiting)
        self._note_clash(head)
        bits = exact_bits(head.frame)
        destroyed = self.faults.loss > 0 and self._random.random() < self.faults.loss
        if destroyed:
            bits += _ERROR_FRAME_BITS
            heappush(self._waiting, head)
        self.busy_bits += bits
        self._busy = True
        self._clock.at(self._clock.now_ns + bits * _NS_PER_S // self.bitrate, lambda: self._end(head, destroyed))

    def _head(self) -> _Waiting | None:
        """Most urgent frame that may be sent, of a station that can send."""
        while self._waiting:
            head = self._waiting[0]
            if head.station.present and not head.station.cut_off and head.until_ns >= self._clock.now_ns:
                return head
            heappop(self._waiting)
            if head.station.cut_off:
                head.station.stranded.append((head.frame, head.until_ns))
        return None

    def _note_clash(self, winner: _Waiting) -> None:
        second = self._head()
        if second is not None and second.key == winner.key and second.station is not winner.station:
            names = (winner.station.name, second.station.name)
            self.clashes.append(Clash(self._clock.now_ns, self.name, winner.frame.can_id, names))

    def _end(self, head: _Waiting, destroyed: bool) -> None:
        self._busy = False
        sender, frame = head.station, head.frame
        if self._waiting:
            self._arbitrate_soon()
        if sender.cut_off and not destroyed:
            sender.stranded.append((frame, head.until_ns))
        if destroyed or not sender.present or sender.cut_off:
            return
        self.frames += 1
        sent = Sent(self._clock.now_ns, self.name, sender.name, frame)
        tampering = self.tamper(sent) if self.tamper is not None else None
        for tap in self.taps:
            tap(sent)
        if tampering is not None or self.faults.omission > 0 or self.faults.doubled > 0:
            self._deliver_with_faults(sender, frame, tampering)
            return
        events: dict[int, Received] = {}
        for station in self._stations.copy():
            if station is sender or station.cut_off or station.deaf or not station.present:
                continue
            event = events.get(station.port)
            if event is None:
                event = events[station.port] = Received(station.port, frame)
            station.listener(event)

    def _deliver_with_faults(self, sender: Station, frame: Frame, tampering: Tampering | None) -> None:
        for station in self._stations.copy():
            if station is sender or station.cut_off or station.deaf:
                continue
            event = Received(station.port, frame)
            for _ in range(self._copies(station, tampering)):
                if station.present:
                    station.listener(event)

    def _copies(self, station: Station, tampering: Tampering | None) -> int:
        if tampering is not None and tampering.receiver in (None, station.name):
            return tampering.copies
        faults = self.faults
        if faults.omission > 0 and self._random.random() < faults.omission:
            return 0
        return 2 if faults.doubled > 0 and self._random.random() < faults.doubled else 1
