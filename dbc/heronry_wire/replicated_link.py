"""A replicated bus of one node: sends every frame on both channels, and gives each received frame to the node once.

To its caller a replicated link is one bus (`AnyLink`): the driver of a node sends a frame once and receives it once,
from whichever channel brings it. `channel_merge` decides which copy is taken, and `channel_watch` which channel is
lost. Each channel is a `Link` with a queue of its own, and neither waits for the other:

    both well      each channel sends the most urgent frame first. When a frame has left one channel, its copy on the
                   other channel is dropped if it cannot start within a quarter of a heartbeat period: a late copy is of
                   no use
    one lags       because of noise, a full queue or an error-passive controller: the copies that wait too long for this
                   channel are dropped. A frame that the controller already has cannot be withdrawn. If such a frame
                   comes late, a receiver does not take it until the other channel brings it, too (`channel_merge`)
    one is lost    because the interface is gone, the controller is bus-off or the wire is cut: the bus works with the
                   other channel. `lost_channels` names the lost channel after `misses` heartbeats, and its link reports
                   a link status event. The link tries to open the channel again and again
    both are lost  the bus is lost, since the time at which the second channel was lost (`off_since_ns`). When one
                   channel returns, the bus is no longer lost
    one returns    the channel is used immediately, with the same rule for late frames. The channel counts as lost until
                   it has kept up for ten periods

A node cannot tell a break of its own wire from a lost channel. If the wire of a sender is broken, the channel seems
lost to the other nodes, too, but only for the frames of that sender.

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
from heronry_wire.frame_port import Arrival
from heronry_wire.link import Link

_DEPARTURES_KEPT = 64


class ReplicatedLink:
    """Two links, one for each channel, that form one bus."""

    def __init__(self, configs: Sequence[Mapping[str, Any]], heartbeat_ns: int, misses: int) -> None:
        """Open both channels of a bus; raises LinkError where neither can be opened.

        misses: heartbeat periods without a sign of life after which a channel is lost.
        """
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
            link.one_at_a_time = True  # a copy may be dropped when the other one has left
            link.on_departure = partial(self._left, channel)

    @property
    def is_open(self) -> bool:
        """Tell whether at least one channel is open."""
        return any(link.is_open for link in self.links)

    @property
    def is_calm(self) -> bool:
        """Tell whether nothing is urgent, so that frames may take a moment."""
        return self.links[0].is_calm

    @is_calm.setter
    def is_calm(self, is_calm: bool) -> None:
        for link in self.links:
            link.is_calm = is_calm

    @property
    def gathers(self) -> bool:
        """Tell whether both channels gather frames for a moment, so that their reader need not."""
        return all(link.gathers for link in self.links)

    @property
    def readers(self) -> Sequence[Link]:
        """Return the links whose file descriptors are to be watched for incoming frames."""
        return [link for link in self.links if link.is_open]

    @property
    def has_more(self) -> bool:
        """Tell whether the last `receive` reached its limit on a channel, so that more frames may wait there."""
        return any(link.has_more for link in self.links)

    @property
    def off_since_ns(self) -> int | None:
        """Time in ns since when both channels are lost; None while at least one can be used."""
        since_ns = [link.off_since_ns for link in self.links]
        known_ns = [one_ns for one_ns in since_ns if one_ns is not None]
        return max(known_ns) if len(known_ns) == len(since_ns) else None

    @property
    def nothing_waits(self) -> bool:
        """Whether at least one open channel has no frame that waits for its controller; True if none is open."""
        return any(link.nothing_waits for link in self.links if link.is_open) or not self.is_open

    @property
    def all_left(self) -> bool:
        """Whether at least one of the two channels has sent all frames that were queued on it."""
        return any(link.all_left for link in self.links)

    @property
    def has_link_events(self) -> bool:
        """Tell whether `take_link_events` has something to give."""
        return any(link.has_link_events for link in self.links)

    def take_link_events(self) -> list[str]:
        """Return the link status events of both channels since the last call, each as a sentence."""
        return [sentence for link in self.links for sentence in link.take_link_events()]

    def lost_channels(self, now_ns: int) -> frozenset[int]:
        """Return the channels, numbered from 1, that are lost for this node while the other one carries frames."""
        return self._watch.lost(now_ns)

    def send(self, frame: Frame, now_ns: int, until_ns: int | None = None) -> None:
        """Queue a copy of a frame on each channel.

        until_ns: a copy whose transmission cannot start by this time is dropped; None: copies do not expire.
        """
        if self.put(frame, until_ns):
            self.pump(now_ns)

    def put(self, frame: Frame, until_ns: int | None) -> bool:
        """Queue a copy of a frame on each channel for the next `pump`; False, without a copy, if both are lost."""
        there = [link.put(frame, until_ns) for link in self.links]
        if not any(there):
            self._departed.append(0)  # a caller that waits for the frame to leave the queue must not wait for ever
        return any(there)

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Remove the queued frames with these identifiers on both channels.

        Frames that a controller already has are still sent.
        """
        for link in self.links:
            link.withdraw(identifiers)

    def stand_back(self, until_ns: int) -> None:
        """Until `until_ns`, send on neither channel any data frame or any frame with a lower priority than data.

        Such frames stay in the queues of both channels.
        """
        for link in self.links:
            link.stand_back(until_ns)

    def accept(
        self,
        identifiers: Collection[int],
        patient: frozenset[int] = frozenset(),  # noqa: ARG002 - the two copies of a frame are compared when they come
    ) -> None:
        """From now on receive only frames with these 11-bit identifiers; on two channels, none of them is patient."""
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
        """On each channel, hand the most urgent queued frame to the controller once it has no other frame of this node.

        The driver calls this after `send`, and at `next_deadline_ns`.
        """
        for link in self.links:
            link.pump(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Time in ns at which `pump` must be called next; None where there is no such time."""
        return min((at_ns for link in self.links if (at_ns := link.next_deadline_ns()) is not None), default=None)

    def departures_ns(self) -> list[int]:
        """Return for each frame sent since the last call how long the controller had it, in ns.

        0 means that the time is not known, or that the frame was dropped because both channels are lost. Of the two
        copies of a frame, the one that was sent first counts.
        """
        departed = list(self._departed)
        self._departed.clear()
        return departed

    def close(self) -> None:
        """Close both channels."""
        for link in self.links:
            link.close()

    def _left(self, channel: int, frame: Frame, now_ns: int, took_ns: int) -> None:
        """Note that a channel has sent its copy of a frame at `now_ns`.

        The other channel drops its own copy if it has not begun to send it within `latest_copy_ns` from `now_ns`.
        took_ns: how long the controller had the copy that was sent.
        """
        self._watch.left(channel, now_ns)
        self.links[1 - channel].queue.limit(frame, now_ns + self._latest_copy_ns, now_ns)
        if self._leaving.take(channel, frame, now_ns):
            self._departed.append(took_ns)
            if self.on_departure is not None:
                self.on_departure(frame, now_ns, took_ns)


AnyLink = Link | ReplicatedLink


def open_link(configs: Sequence[Mapping[str, Any]], heartbeat_ns: int, misses: int) -> AnyLink:
    """Open a bus of one channel or two.

    configs: for each channel the keyword arguments of `can.Bus`. misses: heartbeat periods without a sign of life after
    which a channel is lost. Raises LinkError where no channel can be opened.
    """
    return Link(configs[0]) if len(configs) == 1 else ReplicatedLink(configs, heartbeat_ns, misses)
