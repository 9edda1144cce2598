"""The port of a simulated node on a replicated bus; on a real node this is `heronry_wire.replicated_link`.

To the node, the two channels are one port:

    listener    is called once with each new frame, although there are two copies
    left        is called when the first copy of a frame was sent
    told        is called with the channels that are lost
    witness     is called with every received copy, and with the decision whether it is new; for the oracles

The code that flies (`ChannelMerge`, `ChannelWatch`) decides whether a received copy is a new frame.

A frame is offered to both channels as one Python object. An observer recognizes the two copies by this object; the node
does not use it. When one copy has been sent, the time limit of the other copy is shortened. A simulated controller can
abort a frame that it has not begun to send, so in the simulator no copy is sent after its time limit.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.station import Station
from heronry_wire.channel_merge import ChannelMerge, latest_copy_ns
from heronry_wire.channel_watch import ChannelWatch
from heronry_wire.frame import Frame
from heronry_wire.sansio import NEVER_NS, Received


class Copy(NamedTuple):
    """A copy of a frame that a channel (0 or 1) has delivered to a node.

    is_taken: the node has taken the copy as a new frame; False if it has taken the copy as a repetition
    """

    t_ns: int
    node: str
    bus: str
    channel: int
    frame: Frame
    is_taken: bool


class ReplicatedPort:
    """Two stations, one on each channel, that act as one port."""

    def __init__(
        self,
        clock: Clock,
        wires: Sequence[tuple[SimulatedBus, Station]],
        heartbeat_ns: int,
        misses: int,
        *,
        listener: Callable[[Received], None],
        told: Callable[[frozenset[int]], None],
        witness: Callable[[Copy], None],
    ) -> None:
        """Make one port of the stations on two channels; from now on the port is the listener of both stations.

        wires: for channel 0 and channel 1, the bus and the station on it.
        heartbeat_ns: heartbeat period of the bus.
        misses: heartbeat periods without a sign of life after which a channel is lost.
        listener: gets each frame once.
        told: gets the lost channels, numbered from 1, whenever they change.
        witness: gets every copy that a channel has delivered.
        """
        self.listener = listener
        self.left: Callable[[Frame], None] | None = None
        self._clock, self._wires, self._told, self._witness = clock, tuple(wires), told, witness
        self._merge, self._leaving = ChannelMerge(heartbeat_ns), ChannelMerge(heartbeat_ns)
        self._watch = ChannelWatch(heartbeat_ns, misses, clock.now_ns)
        self._latest_copy_ns = latest_copy_ns(heartbeat_ns)
        self._lost: frozenset[int] = frozenset()
        for channel, (_, station) in enumerate(self._wires):
            station.listener = partial(self._heard, channel)
            station.left = partial(self._has_left, channel)

    def offer(self, frame: Frame, until_ns: int = NEVER_NS) -> None:
        """Queue a frame on both channels; a copy that cannot start by `until_ns` is not sent."""
        sending = frame._replace()
        for bus, station in self._wires:
            bus.offer(station, sending, until_ns)

    def _heard(self, channel: int, event: Received) -> None:
        now_ns = self._clock.now_ns
        self._watch.heard(channel, now_ns)
        is_taken = self._merge.take(channel, event.frame, now_ns)
        bus, station = self._wires[channel]
        self._witness(Copy(now_ns, station.name, bus.name, channel, event.frame, is_taken))
        if is_taken:
            self.listener(event)
        lost = self._watch.lost(now_ns)
        if lost != self._lost:
            self._lost = lost
            self._told(lost)

    def _has_left(self, channel: int, frame: Frame) -> None:
        now_ns = self._clock.now_ns
        self._watch.left(channel, now_ns)
        bus, station = self._wires[1 - channel]
        bus.limit(station, frame, now_ns + self._latest_copy_ns)
        if self.left is not None and self._leaving.take(channel, frame, now_ns):
            self.left(frame)
