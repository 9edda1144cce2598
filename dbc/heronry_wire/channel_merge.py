"""Merges the two channels of a replicated bus: of two copies of a frame the first is taken, the second is dropped.

*Copies.* Every frame of a replicated bus is sent on both channels, and carries no sequence number. So the receiver
recognizes a copy by its content: the same identifier and bytes, on the other channel, within a window of half a
heartbeat period. Equal frames are counted for each channel. If a sender sends two equal frames, two arrive on each
channel, and the receiver takes two, in whatever order the four arrive. Within a window the receiver takes as many equal
frames as the better channel has brought. So a frame is lost only if both channels lose it. There is one exception: a
sender sends two equal frames within half a period, one channel loses the first of them, and the other channel loses the
second. Then the two frames are taken as one.

*Late copies.* A late copy must not be taken for a new frame. A channel that comes back may bring frames that have
waited in a controller, and a state frame that is a second old looks like a restart of the PE. Hence each identifier has
a state:

    in step   both channels have brought the last frame of this identifier. The first copy of the next frame is taken
    behind    one channel has not brought the last frame within half a period: it is the channel *behind*, and the other
              one is the channel *ahead*. A frame that the channel ahead brings is taken. A frame that only the channel
              behind has brought is *withheld*. If the channel ahead brings this frame, too, within half a period, it is
              taken, and the identifier is in step again. If not, the frame is dropped

If the channel ahead has brought nothing under the identifier for a period and a quarter, this channel has failed. Then
a frame that the channel behind brings is taken immediately. So frames with a longer period than 1 1/4 heartbeat periods
are taken however late they come: a late one cannot be told from a new one.

A channel that has lost one frame is behind until the next frame under this identifier. If the channel ahead fails at
that very moment, the sender is not heard for one more period. The standing of the sender does not become SUSPECT in so
short a time.

*Which wire.* The rule is the same whether the channel has failed, or this node's own wire, or the sender's wire. Each
of these failures puts all or some identifiers behind.

*Doubled and forged frames, restarts.* A frame that CAN itself delivers twice is taken twice, as on a bus with one
channel. A forged copy, sent on the other channel before the sender's own frame, has the same bits: the forged copy is
taken, and the sender's own frame counts as its copy. After a restart of this node all identifiers are in step, and each
frame is taken once.

All times are times of arrival. They may be slightly out of order: a process that slept first reads all frames of one
channel, and then those of the other.
"""

from collections import deque
from dataclasses import dataclass

from heronry_wire.frame import Frame
from heronry_wire.protocol_times import late_ns


def window_ns(heartbeat_ns: int) -> int:
    """Longest time in ns between the arrivals of the two copies of a frame on the two channels."""
    return heartbeat_ns // 2


def latest_copy_ns(heartbeat_ns: int) -> int:
    """Longest time in ns between a frame on one channel and its copy on the other, so that it is known as one."""
    return heartbeat_ns // 4


@dataclass(slots=True, eq=False)
class _Copy:
    """A frame that one channel has brought, kept as long as the same frame may still come on the other channel.

    at_ns: time of arrival
    is_taken: the node processed the frame when it arrived
    is_alone: the other channel has not brought the frame yet
    """

    frame: Frame
    channel: int
    at_ns: int
    is_taken: bool
    is_alone: bool = True


class ChannelMerge:
    """Merges the frames of two channels, numbered 0 and 1, into the frames of one bus."""

    def __init__(self, heartbeat_ns: int) -> None:
        self.copies = 0  # frames dropped because the other channel had brought them
        self.stale = 0  # frames withheld whose copy never came
        self._window_ns, self._patience_ns = window_ns(heartbeat_ns), late_ns(heartbeat_ns)
        self._now_ns = 0
        self._alone: dict[Frame, deque[_Copy]] = {}  # frames whose copy has not come, each list from one channel
        self._order: deque[_Copy] = deque()
        self._behind: dict[tuple[int, bool], tuple[int, int]] = {}  # channel that is behind, last time of the other one

    def take(self, channel: int, frame: Frame, at_ns: int) -> bool:
        """Take a frame that has arrived on a channel at `at_ns`; tells whether the node is to process it.

        Returns False for a frame that is withheld, and for the second copy of a frame whose first copy was processed.
        """
        self._expire(at_ns)
        waiting = self._alone.get(frame)
        if waiting is not None and waiting[0].channel != channel:
            return self._pair(waiting)
        is_taken = self._may_lead(channel, frame, at_ns)
        copy = _Copy(frame, channel, at_ns, is_taken)
        self._order.append(copy)
        if waiting is None:
            self._alone[frame] = deque((copy,))
        else:
            waiting.append(copy)
        return is_taken

    def _pair(self, waiting: deque[_Copy]) -> bool:
        """Match a frame that has just arrived with its first copy, the oldest in `waiting`.

        Returns True if the first copy was withheld: then the node must process the frame that has just arrived.
        """
        first = waiting.popleft()
        first.is_alone = False
        if not waiting:
            del self._alone[first.frame]
        self._behind.pop(_identifier(first.frame), None)
        self.copies += 1
        return not first.is_taken

    def _may_lead(self, channel: int, frame: Frame, at_ns: int) -> bool:
        """Tell whether the node is to process a frame that only this channel has brought so far."""
        found = self._behind.get(_identifier(frame))
        if found is None:
            return True
        behind, other_ns = found
        if behind != channel:
            self._behind[_identifier(frame)] = behind, max(other_ns, at_ns)
            return True
        return at_ns - other_ns >= self._patience_ns

    def _expire(self, at_ns: int) -> None:
        """Find the frames whose second copy has not come within the window, and note which channel is behind."""
        self._now_ns = max(self._now_ns, at_ns)
        while self._order and self._order[0].at_ns < self._now_ns - self._window_ns:
            copy = self._order.popleft()
            if not copy.is_alone:
                continue
            waiting = self._alone[copy.frame]
            waiting.popleft()
            if not waiting:
                del self._alone[copy.frame]
            if copy.is_taken:
                self._fall_behind(copy)
            else:
                self.stale += 1

    def _fall_behind(self, copy: _Copy) -> None:
        identifier, other = _identifier(copy.frame), 1 - copy.channel
        behind, other_ns = self._behind.get(identifier, (other, copy.at_ns))
        self._behind[identifier] = other, max(other_ns, copy.at_ns) if behind == other else copy.at_ns


def _identifier(frame: Frame) -> tuple[int, bool]:
    return frame.can_id, frame.extended
