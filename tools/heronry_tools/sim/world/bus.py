"""A simulated CAN bus: priority arbitration, exact frame lengths, and the errors that a wire can cause.

Each station has one frame in its mailbox (`station`). When the bus is free, the most urgent of these frames is sent. It
takes the exact time of its bits, with stuffing and intermission, and is then received by every other station that wants
its identifier. A frame that is offered at the instant at which the bus becomes free takes part in the arbitration of
this instant.

The *rival* of a station sends under the same identifier at the same time. If both send the same bits, they send one
frame together. If the bits differ, both frames are destroyed. Both cases are recorded in `clashes`.

A frame is destroyed by noise (`Faults.loss`, `noisy`), by a transmitter that fails, or by a rival with other bits.
After the bits that were sent, an error frame occupies the bus. The sender and all receivers count an error, and the
sender repeats the frame.

CAN is not an atomic broadcast: a receiver accepts a frame at the last bit but one, the sender only at the last bit. So
one receiver may miss a frame that was sent (`Faults.omission`), or receive the frame twice (`Faults.doubled`). `tamper`
has these effects on a chosen frame. `corrupt` gives all receivers a changed frame instead of the frame that was sent,
like an error that the checksum does not detect.

A station that leaves while it sends destroys its frame. `slowdown` lengthens all bits, as for a radio far from its
base. A wire that is `broken` carries nothing and causes no errors; frames wait until the wire is mended. A bus that is
broken in the middle (`apart`) has two sides that do not hear each other. In the simulator the two sides still share the
capacity of one bus: only one station of both sides sends at a time. Each half of a real bus would have the whole
capacity.

A replicated bus consists of two simulated buses (`replicated_port`). Errors in single bits are not modelled.
"""

from collections.abc import Callable, Container
from dataclasses import dataclass
from functools import partial
from heapq import heapify, heappop, heappush
from random import Random
from typing import NamedTuple

from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.station import (
    BUS_OFF_ABOVE,
    ERROR_PASSIVE_ABOVE,
    RESTART_BITS,
    RESTART_NS,
    SUSPENDED_BITS,
    Station,
    Urgency,
    Waiting,
)
from heronry_wire.frame import Frame, arbitration_key
from heronry_wire.sansio import NEVER_NS, Received
from heronry_wire.timing import exact_bits
from heronry_wire.transmit_queue import FIRST_HELD_BACK

_ERROR_FRAME_BITS = 31
_HEADER_BITS = 19
_NS_PER_S = 1_000_000_000
_TRANSMIT_ERROR, _RECEIVE_ERROR = 8, 1


@dataclass(frozen=True, slots=True)
class Faults:
    """Quality of a bus.

    loss: share of frames that are destroyed
    omission: share of frames that a receiver misses
    doubled: share of frames that a receiver gets twice
    """

    loss: float = 0.0
    omission: float = 0.0
    doubled: float = 0.0


class Sent(NamedTuple):
    """A frame that was sent on a bus; `end_ns` is the end of its last bit."""

    end_ns: int
    bus: str
    sender: str
    frame: Frame


class Clash(NamedTuple):
    """Two stations had frames with the same identifier in one arbitration."""

    t_ns: int
    bus: str
    can_id: int
    stations: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Tampering:
    """How a bus must deliver one frame.

    copies: how often the frame is received; 0 if not at all
    receiver: name of the one station to which `copies` applies; all others receive the frame as usual. None: `copies`
        applies to every station
    """

    copies: int
    receiver: str | None = None


class SimulatedBus:
    """A bus, or one channel of a replicated bus, with its stations."""

    def __init__(self, name: str, bitrate: int, clock: Clock, random: Random, faults: Faults) -> None:
        """Create a bus without stations; a fault that needs a random value takes it from `random`."""
        self.name, self.bitrate, self.faults = name, bitrate, faults
        self.slowdown = 1
        self.broken = 0  # number of breaks in the wire now
        self.noisy = 0  # number of bursts that destroy every frame now
        self.corrupt: Callable[[Sent], Frame | None] | None = None  # gives the frame received instead; None: no change
        self.tamper: Callable[[Sent], Tampering | None] | None = None
        self.apart: Callable[[str, str], bool] | None = None  # tells for sender and receiver whether they are apart
        self.busy_bits = 0  # bits sent so far
        self.frames = 0
        self.destroyed = 0
        self.bus_offs = 0
        self.clashes: list[Clash] = []
        self.taps: list[Callable[[Sent], None]] = []  # observers of every frame; stations do not notice them
        self._clock, self._random = clock, random
        self._stations: list[Station] = []
        self._audience: dict[int, tuple[Station, ...]] = {}  # by identifier; computed when it is first sent
        self._waiting: list[Urgency] = []  # frames in mailboxes
        self._on_air: tuple[Waiting, bool] | None = None  # a frame, and whether it will be destroyed
        self._rival: Waiting | None = None  # the rival's frame that is sent at the same time
        self._arbitration_due = False
        self._offers = 0
        self._joined = 0
        self._errors_count = False  # the error counter of some station is above 0

    @property
    def queued(self) -> int:
        """Return how many frames wait in the mailboxes and queues of those stations that can send."""
        return sum(len(s.queue) + (s.mailbox is not None) for s in self._stations if s.can_send)

    @property
    def is_free(self) -> bool:
        """Tell whether a frame that is offered now is sent at once."""
        return self._on_air is None and not self._arbitration_due and not self.broken

    @property
    def offered(self) -> int:
        """Return the serial number of the frame that was queued last, at any station."""
        return self._offers

    @property
    def longest_waiting(self) -> Waiting | None:
        """Return the frame that has waited longest at a station that can send; None if no frame waits."""
        mailboxes = (s.mailbox for s in self._stations if s.can_send and s.mailbox is not None)
        queues = (waiting for s in self._stations if s.can_send for _, _, waiting in s.queue)
        return min((*mailboxes, *queues), key=lambda waiting: waiting.offer, default=None)

    def join(
        self, name: str, port: int, listener: Callable[[Received], None], wants: Container[int] | None = None
    ) -> Station:
        """Connect a station; it receives the identifiers in `wants`, by default all."""
        self._joined += 1
        station = Station(name, port, self._joined, listener)
        if wants is not None:
            station.wants = wants
        self._stations.append(station)
        self._audience.clear()
        return station

    def wants(self, station: Station, identifiers: Container[int]) -> None:
        """Set the identifiers that a station receives from now on."""
        station.wants = identifiers
        self._audience.clear()

    def leave(self, station: Station) -> None:
        """Disconnect a station for good; the frames in its queue and mailbox are lost."""
        station.present = False
        station.reconsider()
        station.mailbox = None
        self._stations.remove(station)
        self._audience.clear()

    def wire(
        self,
        station: Station,
        *,
        cut_off: bool | None = None,
        transmit_failed: bool | None = None,
        receive_failed: bool | None = None,
    ) -> None:
        """Break or repair the wire of a station, in both directions or in one; omitted arguments change nothing."""
        station.cut_off = station.cut_off if cut_off is None else cut_off
        station.transmit_failed = station.transmit_failed if transmit_failed is None else transmit_failed
        station.receive_failed = station.receive_failed if receive_failed is None else receive_failed
        station.reconsider()
        self._wake(station)

    def stall(self, station: Station, *, stalled: bool) -> None:
        """Pause a station's processor, or end the pause; the controller still sends the frame in its mailbox."""
        station.stalled = stalled
        self._wake(station)

    def break_wire(self) -> None:
        """Break the wire for all stations; each break needs its own `mend_wire`."""
        self.broken += 1

    def mend_wire(self) -> None:
        """Mend one break."""
        self.broken -= 1
        if not self.broken:
            for station in self._stations:
                self._wake(station)

    def turn_off(self, station: Station) -> None:
        """Put a station bus-off, as 32 failed frames in a row would do."""
        station.transmit_errors = BUS_OFF_ABOVE + 1
        self._go_off(station)

    def offer(self, station: Station, frame: Frame, until_ns: int = NEVER_NS) -> None:
        """Queue a frame at a station; the frame is dropped if its transmission cannot start by `until_ns`."""
        if not station.present:
            return
        self._offers = offer = self._offers + 1
        waiting = Waiting(arbitration_key(frame), offer, station, frame, until_ns)
        may_go = station.mailbox is None and not station.stalled and not self._stands_back(waiting)
        if may_go and not station.queue:
            station.mailbox = waiting
            if self._errors_count:
                self._enter(station)
            else:
                self._wait_for_bus(station)
        else:
            heappush(station.queue, (waiting.key, offer, waiting))
            if may_go:  # a more urgent frame that has waited through bus-off or `stand_back` goes first
                self._refill(station)

    def limit(self, station: Station, frame: Frame, until_ns: int) -> None:
        """Lower the time until which the transmission of a frame may start; an earlier limit stays.

        `frame` must be the object that was offered.
        """
        for waiting in (station.mailbox, *(waiting for _, _, waiting in station.queue)):
            if waiting is not None and waiting.frame is frame:
                waiting.until_ns = min(waiting.until_ns, until_ns)
                return

    def withdraw(self, station: Station, identifiers: frozenset[int]) -> None:
        """Drop the queued frames of a station with these identifiers; a frame in the mailbox is still sent."""
        station.queue = [urgency for urgency in station.queue if urgency[2].frame.can_id not in identifiers]
        heapify(station.queue)

    def stand_back(self, station: Station, until_ns: int) -> None:
        """Hold back a station's data frames, and its frames less urgent than data, until `until_ns`."""
        station.stands_back_until_ns = until_ns
        self._clock.at(until_ns, lambda: self._refill(station) if station.mailbox is None else None)

    # Mailboxes

    def _stands_back(self, waiting: Waiting) -> bool:
        return waiting.key >= FIRST_HELD_BACK and self._clock.now_ns < waiting.station.stands_back_until_ns

    def _refill(self, station: Station) -> None:
        """Move the next frame of a station from its queue to its mailbox; drop frames whose time limit is over.

        Nothing is moved while the station is stalled, or while the next frame is held back (`_stands_back`).
        """
        queue, now_ns = station.queue, self._clock.now_ns
        while queue and not station.stalled and not self._stands_back(queue[0][2]):
            waiting = heappop(queue)[2]
            if waiting.until_ns >= now_ns:
                station.mailbox = waiting
                self._enter(station)
                return

    def _enter(self, station: Station) -> None:
        """Let the frame in a mailbox take part in arbitration; an error-passive station first waits for 8 bits."""
        if station.is_passive:
            suspended_ns = self._duration_ns(SUSPENDED_BITS)
            self._clock.at(self._clock.now_ns + suspended_ns, partial(self._wait_for_bus, station))
        else:
            self._wait_for_bus(station)

    def _wait_for_bus(self, station: Station) -> None:
        waiting = station.mailbox
        if waiting is None or not station.can_send:
            return
        heappush(self._waiting, (waiting.key, waiting.offer, waiting))
        if self._on_air is None and not self._arbitration_due:
            self._arbitration_due = True
            self._clock.at_last(self._arbitrate)

    def _wake(self, station: Station) -> None:
        if station.mailbox is None:
            self._refill(station)
        else:
            self._wait_for_bus(station)

    # Arbitration

    def _arbitrate(self) -> None:
        self._arbitration_due = False
        head = self._head() if self._on_air is None and not self.broken else None
        if head is None:
            return
        heappop(self._waiting)
        frame = head.frame
        bits = exact_bits(frame)
        destroyed = False
        if self._waiting and self._waiting[0][0] == head.key:
            destroyed, bits = self._meet_rival(head, bits)
        if self.noisy or head.station.fails or (self.faults.loss and self._random.random() < self.faults.loss):
            destroyed = True
            bits = self._random.randint(1, bits)
        if destroyed:
            bits += _ERROR_FRAME_BITS
        self.busy_bits += bits
        self._on_air = (head, destroyed)
        clock = self._clock
        clock.at(clock.now_ns + bits * self.slowdown * _NS_PER_S // self.bitrate, self._end)

    def _duration_ns(self, bits: int) -> int:
        return bits * self.slowdown * _NS_PER_S // self.bitrate

    def _head(self) -> Waiting | None:
        """Return the most urgent of the frames that wait for the bus; None if no frame waits.

        Frames of stations that cannot send do not count. A frame whose time limit is over is dropped, and the next
        frame of its station takes its place.
        """
        waiting, now_ns = self._waiting, self._clock.now_ns
        while waiting:
            head = waiting[0][2]
            station = head.station
            if station.mailbox is head and station.can_send:
                if head.until_ns >= now_ns:
                    return head
                station.mailbox = None
                heappop(waiting)
                self._refill(station)
            else:
                heappop(waiting)
        return None

    def _meet_rival(self, head: Waiting, bits: int) -> tuple[bool, int]:
        """Find a rival: another station that sends under the identifier of `head` at the same time.

        Returns whether both frames are destroyed, and how many bits are sent. Without a rival, or if both frames
        have the same data, these are False and `bits`, the length of the frame.
        """
        rival = self._head()
        if rival is None or rival.key != head.key or rival.station is head.station:
            return False, bits
        if self._are_apart(head.station, rival.station):
            return False, bits
        stations = head.station.name, rival.station.name
        self.clashes.append(Clash(self._clock.now_ns, self.name, head.frame.can_id, stations))
        heappop(self._waiting)
        self._rival = rival
        mine, others = head.frame.data, rival.frame.data
        if mine == others:
            return False, bits
        differ = (i for i, (a, b) in enumerate(zip(mine, others, strict=False)) if a != b)
        same_bytes = next(differ, min(len(mine), len(others)))
        return True, min(bits, _HEADER_BITS + 8 * (same_bytes + 1))

    def _are_apart(self, one: Station, other: Station) -> bool:
        apart = self.apart
        return apart is not None and (apart(one.name, other.name) or apart(other.name, one.name))

    # The end of a frame

    def _end(self) -> None:
        assert self._on_air is not None
        head, destroyed = self._on_air
        rival, self._rival, self._on_air = self._rival, None, None
        sender, frame = head.station, head.frame
        if self.broken:
            return
        if destroyed or not sender.can_send:
            self._fail(head, rival)
        else:
            sender.mailbox = None
            if sender.queue:
                self._refill(sender)
            if rival is not None and rival.station.mailbox is rival:
                rival.station.mailbox = None
                self._refill(rival.station)
            if self._errors_count:
                self._forgive(sender)
            self.frames += 1
            self._hand_out(sender, frame)
            if sender.left is not None:
                sender.left(frame)
        if self._waiting and not self._arbitration_due:
            if self._clock.is_last_now():
                self._arbitrate()
            else:
                self._arbitration_due = True
                self._clock.at_last(self._arbitrate)

    def _hand_out(self, sender: Station, frame: Frame) -> None:
        sent = Sent(self._clock.now_ns, self.name, sender.name, frame)
        tampering = self.tamper(sent) if self.tamper is not None else None
        for tap in self.taps:
            tap(sent)
        if self.corrupt is not None:
            frame = self.corrupt(sent) or frame
        audience = self._audience.get(frame.can_id)
        if audience is None:
            audience = tuple(station for station in self._stations if frame.can_id in station.wants)
            self._audience[frame.can_id] = audience
        perfect = tampering is None and not self.faults.omission and not self.faults.doubled and self.apart is None
        event = Received(0, frame)
        for station in audience:
            if station is sender or not station.can_hear:
                continue
            if event.port != station.port:
                event = Received(station.port, frame)
            if perfect:
                station.listener(event)
                continue
            for _ in range(self._copies(sender, station, tampering)):
                if station.present:
                    station.listener(event)

    def _copies(self, sender: Station, station: Station, tampering: Tampering | None) -> int:
        if self.apart is not None and self.apart(sender.name, station.name):
            return 0
        if tampering is not None and tampering.receiver in (None, station.name):
            return tampering.copies
        faults = self.faults
        if faults.omission > 0 and self._random.random() < faults.omission:
            return 0
        return 2 if faults.doubled > 0 and self._random.random() < faults.doubled else 1

    # Errors

    def _fail(self, head: Waiting, rival: Waiting | None) -> None:
        """Count a destroyed frame as an error at every sender and every station that can hear.

        Each sender then sends its frame again, or goes off the bus if it has too many errors.

        rival: the other sender in the same arbitration; None if there is none.
        """
        self.destroyed += 1
        self._errors_count = True
        senders = [waiting.station for waiting in (head, rival) if waiting is not None]
        for station in self._stations:
            if station in senders:
                station.transmit_errors += _TRANSMIT_ERROR
            elif station.can_hear:
                station.receive_errors = min(station.receive_errors + _RECEIVE_ERROR, ERROR_PASSIVE_ABOVE + 1)
        for station in senders:
            if station.transmit_errors > BUS_OFF_ABOVE:
                self._go_off(station)
            elif station.mailbox is not None:
                self._enter(station)

    def _forgive(self, sender: Station) -> None:
        sender.transmit_errors = max(sender.transmit_errors - 1, 0)
        for station in self._stations:
            if station is not sender and station.receive_errors and station.can_hear:
                station.receive_errors -= 1
        self._errors_count = any(s.transmit_errors or s.receive_errors for s in self._stations)

    def _go_off(self, station: Station) -> None:
        if station.off or not station.present:
            return
        self.bus_offs += 1
        station.off, station.mailbox = True, None
        station.reconsider()
        restart_ns = RESTART_NS + self._duration_ns(RESTART_BITS)
        self._clock.at(self._clock.now_ns + restart_ns, lambda: self._restart(station))

    def _restart(self, station: Station) -> None:
        station.off, station.transmit_errors, station.receive_errors = False, 0, 0
        station.reconsider()
        if station.present:
            self._wake(station)
