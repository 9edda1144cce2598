"""Base of simulated nodes: a clock of the node's own, one timer, and a processor that may be paused.

A node uses a `Station` and the virtual `Clock` as a real driver uses a socket and a timer. While the node's processor
is paused, its CAN controllers keep working: the frame in the mailbox is sent, and frames that arrive are kept, up to
the capacity of a socket. After the pause the core first gets the kept frames, with their age; only then is it called
for deadlines that have passed.
"""

from collections.abc import Callable, Container, Sequence
from functools import partial

from heronry_dg.model import Bus
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.replicated_port import Copy, ReplicatedPort
from heronry_tools.sim.world.station import Station
from heronry_wire.frame import Frame
from heronry_wire.pe_table import Port
from heronry_wire.sansio import NEVER_NS, Received, require

RECEIVE_BUFFER = 300  # frames; about as many as a socket with Linux's default buffer holds before it drops frames
VALIDATED_EVERY = 16  # after one of so many calls with only routine work, the core's invariants are checked
_MOST_RINGS_AT_ONCE = 1000


class Node:
    """Base of the simulated PE and of the simulated manager."""

    def __init__(self, clock: Clock, time: LocalClock) -> None:
        self.time = time
        self.running = True
        self.stations: list[tuple[SimulatedBus, Station]] = []  # two on a replicated bus
        self._ears: list[Station | ReplicatedPort] = []  # by port: one for both channels of a bus
        self._offers: list[Callable[[Frame, int], None]] = []  # by port
        self._clock = clock
        self._armed_ns = NEVER_NS  # on the node's own clock
        self._last_ring_ns, self._rings = -1, 0  # when the timer last expired, and how often then
        self._paused_until_ns: int | None = None
        self._kept: list[tuple[int, Received]] = []

    def _join(
        self,
        name: str,
        wires: Sequence[SimulatedBus],
        entry: Port | Bus,
        witness: Callable[[Copy], None],
        wants: Container[int] | None = None,
    ) -> None:
        """Join a bus on each of its channels.

        name: name of the node's station.
        wires: the channels of the bus; one if it is not replicated.
        entry: the bus as the PE's table or the spec describes it.
        witness: gets every copy that a channel of a replicated bus has delivered.
        wants: identifiers of the frames to receive; None: all.
        """
        port = len(self._offers)
        joined = [(wire, wire.join(name, port, self._take, wants)) for wire in wires]
        self.stations += joined
        if len(joined) == 1:
            bus, station = joined[0]
            self._ears.append(station)
            self._offers.append(partial(bus.offer, station))
            return
        told = partial(self._channels_lost, port)
        twin = ReplicatedPort(
            self._clock, joined, entry.heartbeat_ns, entry.misses, listener=self._take, told=told, witness=witness
        )
        self._ears.append(twin)
        self._offers.append(twin.offer)

    def stop(self) -> None:
        """Stop the node for good: it leaves its buses, and its queued frames are lost; no effect if it has stopped."""
        if not self.running:
            return
        self.running = False
        for bus, station in self.stations:
            bus.leave(station)

    def wire(
        self, *, cut_off: bool | None = None, transmit_failed: bool | None = None, receive_failed: bool | None = None
    ) -> None:
        """Break or repair all wires of the node, in both directions or in one; the node runs on.

        Each argument: True sets this failure, False ends it, None changes nothing.
        """
        for bus, station in self.stations:
            bus.wire(station, cut_off=cut_off, transmit_failed=transmit_failed, receive_failed=receive_failed)

    def pause(self, duration_ns: int) -> None:
        """Pause the processor from now on; no effect if an earlier pause lasts as long, or longer."""
        until_ns = self._clock.now_ns + duration_ns
        if self._paused_until_ns is not None and self._paused_until_ns >= until_ns:
            return
        if self._paused_until_ns is None:
            for bus, station in self.stations:
                bus.stall(station, stalled=True)
            for ear in self._ears:
                ear.listener = self._keep
        self._paused_until_ns = until_ns
        self._clock.at(until_ns, self._go_on)

    @property
    def is_awake(self) -> bool:
        """Tell whether the node is alive and its processor is not paused."""
        return self.running and self._paused_until_ns is None

    def _go_on(self) -> None:
        if not self.running or self._paused_until_ns is None or self._clock.now_ns < self._paused_until_ns:
            return
        self._paused_until_ns = None
        for bus, station in self.stations:
            bus.stall(station, stalled=False)
        for ear in self._ears:
            ear.listener = self._take
        self._resume()
        while self._kept and self.is_awake:
            arrived_ns, event = self._kept.pop(0)
            age_ns = self._clock.now_ns - arrived_ns
            self._take(Received(event.port, event.frame, age_ns))
        if self.is_awake:
            self._caught_up()
            self._wake()

    def _keep(self, event: Received) -> None:
        """Keep a frame that was received while the processor is paused."""
        if len(self._kept) < RECEIVE_BUFFER:
            self._kept.append((self._clock.now_ns, event))

    # The timer: a new setting replaces the one before, whose callback then has no effect

    def _arm(self, due_ns: int) -> None:
        """Set the timer to this time on the node's own clock."""
        self._armed_ns = due_ns
        self._clock.at(self.time.when_ns(due_ns), self._ring)

    def _ring(self) -> None:
        if not self.running or self._armed_ns > self.time.now_ns():
            return
        self._armed_ns = NEVER_NS
        if self._paused_until_ns is not None:
            return
        now_ns = self._clock.now_ns
        self._rings = self._rings + 1 if now_ns == self._last_ring_ns else 1
        self._last_ring_ns = now_ns
        require(self._rings <= _MOST_RINGS_AT_ONCE, "a core requests to be called at {} ns without end", now_ns)
        self._wake()

    # What each kind of node does

    def _take(self, event: Received) -> None:
        """Give the core a received frame."""
        raise NotImplementedError

    def _channels_lost(self, port: int, lost: frozenset[int]) -> None:
        """Report to the core the channels (from 1) of a port's bus on which this node receives nothing."""
        raise NotImplementedError

    def _wake(self) -> None:
        """Call the core if its deadline is due, and set the timer to the next deadline."""
        raise NotImplementedError

    def _resume(self) -> None:
        """Complete the work that the pause has interrupted; called first at the end of a pause."""

    def _caught_up(self) -> None:
        """Give the core the events that the pause has delayed.

        Called at the end of a pause, after the core was given all frames that were kept during the pause.
        """
