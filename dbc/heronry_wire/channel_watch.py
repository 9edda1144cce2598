"""Finds the lost channel of a replicated bus: for one node, a channel without frames while the other channel has some.

A node sees two kinds of signs of life on a channel: a frame of another node has come, and a frame of this node has
left. For each kind, the last sign on one channel is compared with the last sign on the other channel.

    well    both channels give signs of life, or neither does: on a silent bus nothing can be decided
    lost    in one of the two kinds, the channel has given no sign for `misses` heartbeat periods and a quarter, while
            the other channel did. Every node sends in every period, so a silence of that length is a failure

A lost channel is well again when it has given signs for ten periods without such a gap. So an intermittent channel
stays lost.

One kind without signs is enough: so a wire that is broken in one direction is found, too. One node cannot tell whether
the channel or only its own wire has failed. The manager can, from the reports of all nodes.

Neither a pause of the process nor a silent bus makes a channel lost, since then the signs of both channels are missing.
A late frame is a late sign; after a lost frame the next frame is the sign; a doubled frame changes nothing.
"""

from heronry_wire.protocol_times import HOLD_DOWN_PERIODS, silent_ns


class ChannelWatch:
    """Watches the two channels of a bus for signs of life.

    Arguments number the channels 0 and 1; results number them 1 and 2.
    """

    def __init__(self, heartbeat_ns: int, misses: int, now_ns: int) -> None:
        """Begin with both channels well.

        heartbeat_ns: heartbeat period of the bus.
        misses: after so many heartbeat periods and a quarter, a channel is lost if it has given no sign of life
            while the other channel has.
        """
        self._patience_ns = silent_ns(heartbeat_ns, misses)
        self._hold_down_ns = HOLD_DOWN_PERIODS * heartbeat_ns
        self._heard_ns = [now_ns, now_ns]
        self._left_ns = [now_ns, now_ns]
        self._kept_up_ns = [now_ns, now_ns]  # since when each channel has had no gap
        self._lost: frozenset[int] = frozenset()

    def heard(self, channel: int, at_ns: int) -> None:
        """Note that a channel has brought a frame of another node."""
        self._sign(self._heard_ns, channel, at_ns)

    def left(self, channel: int, at_ns: int) -> None:
        """Note that a channel has carried a frame that this node sent, at the time `at_ns`."""
        self._sign(self._left_ns, channel, at_ns)

    def lost(self, now_ns: int) -> frozenset[int]:
        """Return the channels that are lost for this node, numbered from 1."""
        if self._lost or self._lags(0) or self._lags(1):
            self._lost = frozenset(channel + 1 for channel in (0, 1) if self._is_lost(channel, now_ns))
        return self._lost

    def _is_lost(self, channel: int, now_ns: int) -> bool:
        if self._lags(channel):
            return True
        return channel + 1 in self._lost and now_ns - self._kept_up_ns[channel] < self._hold_down_ns

    def _lags(self, channel: int) -> bool:
        other, most_ns = 1 - channel, self._patience_ns
        return (
            self._heard_ns[other] - self._heard_ns[channel] > most_ns
            or self._left_ns[other] - self._left_ns[channel] > most_ns
        )

    def _sign(self, last_ns: list[int], channel: int, at_ns: int) -> None:
        if last_ns[1 - channel] - last_ns[channel] > self._patience_ns:
            self._kept_up_ns[channel] = at_ns
        last_ns[channel] = max(last_ns[channel], at_ns)
