"""Two channels, one bus: of the two copies of a frame the first is taken, and the second is recognized as a copy.

Every frame of a replicated bus is sent on both channels, and carries no number of its sending. So a copy is recognized
by its content: the same identifier and bytes, on the other channel, within a window of half a heartbeat period. Copies
are counted for each channel: two equal frames that are sent one after the other are two on each channel, and are taken
twice, in whatever order the four arrive. Within a window as many of a frame are taken as the better channel has
brought; so no frame is lost that either channel alone would have brought, except in one case: one of two equal frames
that follow each other within half a period, if each channel loses another one of the two.

Late copies are the danger: a channel that comes back may bring frames that waited in a controller meanwhile, and a
state that is a second old looks like a restart. Hence for each identifier

    in step     both channels have brought the last frame of it: the first copy of the next one is taken
    behind      one channel has not, and half a period has passed: a frame that only this channel brings is *withheld*
                until the other one brings it too (then it is taken, and both are in step), or has brought nothing under
                this identifier for a period and a quarter (then it is taken immediately: the other one has failed)

A channel that has lost a single frame of a sender is behind for one frame of it. If the other one fails at that very
moment, that sender is not heard for one more period, which is too short to make it suspect. Frames with a period longer
than 1 1/4 heartbeat periods are taken however late they come: they cannot be told from new ones.

It makes no difference which wire has failed: a break of the channel, of this node's own wire, or of the sender's wire
alone leaves the sender's identifiers behind, all or some. Doubled by a controller (CAN may bring a frame twice): taken
twice, as on one channel, or its second copy is. Forged: an attacker who sends the same bits on the other channel before
the frame itself has sent a true frame; the sender's own one then counts as the copy. After a restart all identifiers
are in step, and each frame is taken once.

Time is that of arrival, and may come a little out of order, as when a process that slept empties one socket after the
other.
"""

from collections import deque
from dataclasses import dataclass

from heronry_wire.frame import Frame
from heronry_wire.protocol_times import late_ns


def window_ns(heartbeat_ns: int) -> int:
    """Longest time in ns between the arrivals of two copies of a frame."""
    return heartbeat_ns // 2


def latest_copy_ns(heartbeat_ns: int) -> int:
    """Time in ns after the first copy has left in which the second may start, so that it arrives in the window."""
    return heartbeat_ns // 4


@dataclass(slots=True, eq=False)
class _Copy:
    """A frame that one channel has brought and the other has not yet."""

    frame: Frame
    channel: int
    at_ns: int
    is_taken: bool
    is_alone: bool = True


class ChannelMerge:
    """Merges the frames of two channels into those of one bus; channels are 0 and 1 here."""

    def __init__(self, heartbeat_ns: int) -> None:
        """`heartbeat_ns` is the heartbeat period of the bus."""
        self.copies = 0  # dropped, since the other channel had brought them
        self.stale = 0  # withheld for good
        self._window_ns, self._patience_ns = window_ns(heartbeat_ns), late_ns(heartbeat_ns)
        self._now_ns = 0
        self._alone: dict[Frame, deque[_Copy]] = {}  # copies of one frame, all from one channel
        self._order: deque[_Copy] = deque()
        self._behind: dict[tuple[int, bool], tuple[int, int]] = {}  # channel, last time of the other

    def take(self, channel: int, frame: Frame, at_ns: int) -> bool:
        """Tell whether a frame that has arrived is to be taken."""
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
        """The second copy has come: tell whether to take it, which is so if the first one was withheld."""
        first = waiting.popleft()
        first.is_alone = False
        if not waiting:
            del self._alone[first.frame]
        self._behind.pop(_identifier(first.frame), None)
        self.copies += 1
        return not first.is_taken

    def _may_lead(self, channel: int, frame: Frame, at_ns: int) -> bool:
        """Tell whether a frame is taken from this channel before the other one has brought it."""
        found = self._behind.get(_identifier(frame))
        if found is None:
            return True
        behind, other_ns = found
        if behind != channel:
            self._behind[_identifier(frame)] = behind, max(other_ns, at_ns)
            return True
        return at_ns - other_ns >= self._patience_ns

    def _expire(self, at_ns: int) -> None:
        """A frame whose window has passed without a copy stays alone: the other channel is behind."""
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
