"""A replicated bus of one node: every frame goes out on both channels, and is taken once from either.

To its caller a replicated link is one bus (`AnyLink`): the driver of a node sends a frame once and receives it once,
from whichever channel brings it. `channel_merge` decides which copy is taken, and `channel_watch` which channel is
lost. Each channel is a `Link` with a queue of its own, and neither waits for the other:

    both well      each sends the most urgent frame first. When a frame has left one channel, its copy on the other has
                   a quarter of a heartbeat period left to start, and is then dropped: a late copy is of no use
    one lags       (noise, a full queue, an error-passive controller) copies that wait too long on it are dropped. A
                   frame that its controller already has cannot be withdrawn; a receiver withholds that frame if it
                   comes late
    one is lost    (the interface is gone, bus-off, the wire is cut) the bus goes on: `lost_channels` names the channel
                   after `misses` heartbeats, and its link reports an event. The link tries to open the channel again
                   and again
    both are lost  the bus is lost, since the time at which the second channel was lost (`off_since_ns`). When one
                   channel returns, the bus is no longer lost
    one returns    the channel is used immediately, and late frames on it are withheld (`channel_merge`). The channel
                   counts as lost until it has kept up for ten periods

A node sees a break of its own wire, and a break of a sender's wire, as it would see a lost channel; the latter affects
only frames of that sender.

At the start one channel may be missing, since a node must come up in flight when a wire has failed: LinkError is raised
only if neither channel can be opened.

Not detected here: if one node has lost channel 1 and another node channel 2, these two do not hear each other, while
all other nodes hear both. Each node reports its own loss, and the operator has to decide.

A bus with one channel is a plain `Link` (`open_link`), and does not use this file's code.
"""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from time import monotonic_ns
from typing import Any

from heronry_wire.bus_opening import LinkError
from heronry_wire.channel_merge import ChannelMerge, latest_copy_ns
from heronry_wire.channel_watch import ChannelWatch
from heronry_wire.frame import Frame
from heronry_wire.link import Arrival, Link

_DEPARTURES_KEPT = 64


class ReplicatedLink:
    """Two links that form one bus."""

    def __init__(self, configs: Sequence[Mapping[str, Any]], heartbeat_ns: int, misses: int) -> None:
        """Open both channels of a bus with this heartbeat and misses; raises LinkError where neither can be opened."""
        self.links = tuple(Link(config, may_begin_lost=True) for config in configs)
        self.merge = ChannelMerge(heartbeat_ns)
        self.name = " and ".join(link.name for link in self.links)
        if not any(link.is_open for link in self.links):
            raise LinkError("; ".join(f"{link.name} cannot be opened: {link.health.reason}" for link in self.links))
        self._watch = ChannelWatch(heartbeat_ns, misses, monotonic_ns())
        self._latest_copy_ns = latest_copy_ns(heartbeat_ns)
        self._leaving = ChannelMerge(heartbeat_ns)  # tells which of the two copies of a frame leaves first
        self._departed: deque[int] = deque(maxlen=_DEPARTURES_KEPT)
        self.on_departure: Callable[[Frame, int, int], None] | None = None  # for first copies, as in `Link`
        for channel, link in enumerate(self.links):
            link.on_departure = partial(self._left, channel)

    @property
    def is_open(self) -> bool:
        """Tell whether some channel is open."""
        return any(link.is_open for link in self.links)

    @property
    def readers(self) -> Sequence[Link]:
        """Links to select on for incoming frames."""
        return [link for link in self.links if link.is_open]

    @property
    def has_more(self) -> bool:
        """Tell whether the last `receive` took a whole burst of some channel."""
        return any(link.has_more for link in self.links)

    @property
    def off_since_ns(self) -> int | None:
        """Time in ns since when both channels are lost; None while one can be used."""
        since_ns = [link.off_since_ns for link in self.links]
        known_ns = [one_ns for one_ns in since_ns if one_ns is not None]
        return max(known_ns) if len(known_ns) == len(since_ns) else None

    @property
    def nothing_waits(self) -> bool:
        """Tell whether all queued frames have been handed over, on a channel that is open."""
        return any(link.nothing_waits for link in self.links if link.is_open) or not self.is_open

    @property
    def all_left(self) -> bool:
        """Tell whether all queued frames have left on some channel."""
        return any(link.all_left for link in self.links)

    def take_link_events(self) -> list[str]:
        """Give the link status events of both channels since the last call, as sentences."""
        return [sentence for link in self.links for sentence in link.take_link_events()]

    def lost_channels(self, now_ns: int) -> frozenset[int]:
        """Channels, counted from 1, that carry no frames although the other one does."""
        return self._watch.lost(now_ns)

    def send(self, frame: Frame, now_ns: int, until_ns: int | None = None) -> None:
        """Queue a frame on both channels; a copy that cannot start by `until_ns` is dropped."""
        there = [link for link in self.links if link.put(frame, until_ns)]
        if not there:
            self._departed.append(0)  # it has left the queue, for a caller that waits for it
        for link in there:
            link.pump(now_ns)

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Remove the frames that wait under these identifiers from both queues.

        A frame that a controller has is not affected.
        """
        for link in self.links:
            link.withdraw(identifiers)

    def stand_back(self, until_ns: int) -> None:
        """Hold data, and frames with a lower priority, in both queues until `until_ns`."""
        for link in self.links:
            link.stand_back(until_ns)

    def accept(self, identifiers: Collection[int]) -> None:
        """Receive only frames with these 11-bit identifiers from now on, and the echoes of this node's own frames."""
        for link in self.links:
            link.accept(identifiers)

    def receive(self, now_ns: int) -> list[Arrival]:
        """Read the frames that have arrived on either channel, each frame once, without waiting."""
        arrived = [(arrival, channel) for channel, link in enumerate(self.links) for arrival in link.receive(now_ns)]
        arrived.sort(key=lambda one: one[0].time_ns)
        taken = []
        for arrival, channel in arrived:
            self._watch.heard(channel, arrival.time_ns)
            if self.merge.take(channel, arrival.frame, arrival.time_ns):
                taken.append(arrival)
        return taken

    def pump(self, now_ns: int) -> None:
        """Hand over the next frame on each channel. The driver calls this after `send`, and at `next_deadline_ns`."""
        for link in self.links:
            link.pump(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Time in ns at which to call `pump` at the latest; None: no deadline."""
        return min((at_ns for link in self.links if (at_ns := link.next_deadline_ns()) is not None), default=None)

    def departures_ns(self) -> list[int]:
        """Give, for each frame that has left since the last call, how long it was in the controller, in ns.

        The controller is that of the channel that sent the frame first.
        """
        departed = list(self._departed)
        self._departed.clear()
        return departed

    def close(self) -> None:
        """Close both channels."""
        for link in self.links:
            link.close()

    def _left(self, channel: int, frame: Frame, now_ns: int, took_ns: int) -> None:
        """Note that a frame has left on one channel, and limit how long its copy may wait on the other."""
        self._watch.left(channel, now_ns)
        self.links[1 - channel].queue.limit(frame, now_ns + self._latest_copy_ns, now_ns)
        if self._leaving.take(channel, frame, now_ns):
            self._departed.append(took_ns)
            if self.on_departure is not None:
                self.on_departure(frame, now_ns, took_ns)


AnyLink = Link | ReplicatedLink


def open_link(configs: Sequence[Mapping[str, Any]], heartbeat_ns: int, misses: int) -> AnyLink:
    """Open a bus on the channels that python-can's keyword arguments describe, one or two; raises LinkError."""
    return Link(configs[0]) if len(configs) == 1 else ReplicatedLink(configs, heartbeat_ns, misses)
