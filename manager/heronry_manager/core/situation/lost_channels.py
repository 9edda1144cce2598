"""Channels of replicated buses that carry nothing for some node; a lost channel is not a fault.

This manager's driver and the PEs report lost channels. A bus with one channel left still works: no plan changes, no
epoch is given up, and the contingencies can still be used. If both channels of a bus are lost, the PEs of the bus are
silent, and `health` deals with that. So lost channels are no part of the situation. They are kept for the operator: an
event reports when a node loses a channel or has it back, and `heronry status` lists the nodes that lack each channel.
If all nodes on a bus lack a channel, the channel is broken; if one PE lacks it, the wire of that PE is broken.

For each PE a channel is in one of two states:

    lost    the PE has reported the loss (EMCY CHANNEL_LOST) within the last CHANNEL_FORGOTTEN_NS
    well    the PE has reported CHANNEL_BACK, or has reported no loss within the last CHANNEL_FORGOTTEN_NS

For the manager itself a channel is lost or well as its driver reports it.

A PE repeats its report every second, so the loss of one report does no harm. A late or doubled report has no effect. A
forged report makes a false line in the status, for at most CHANNEL_FORGOTTEN_NS. A manager that restarts, or takes
over, knows the channels within a second. A report about a channel that the spec does not have is ignored.
"""

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.turn import Turn
from heronry_wire.management import Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS

OWN = "the manager"


class LostChannels:
    """Keeps which node hears nothing on which channel of a replicated bus."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._spec, self._turn = spec, turn
        self._told_ns: dict[tuple[str, str], int] = {}  # (channel, node that lacks it) -> time of the last report
        self._own: frozenset[str] = frozenset()

    def own(self, channels: frozenset[int]) -> None:
        """Note the channels of the manager's bus on which this manager hears nothing, as its driver reports them."""
        before, self._own = self._own, frozenset(f"{self._spec.manager.bus}.{number}" for number in channels)
        for channel in sorted(self._own - before):
            self._turn.emit(events.ChannelLost, channel=channel, by=OWN)
        for channel in sorted(before - self._own):
            self._turn.emit(events.ChannelBack, channel=channel, by=OWN)

    def reported(self, pe: str, emergency: Emergency) -> None:
        """Note a PE's report that a channel of one of its buses carries nothing, or carries frames again."""
        buses = self._spec.pes[pe].buses
        bus = self._spec.buses[buses[emergency.index]] if emergency.index < len(buses) else None
        if bus is None or bus.channels == 1 or not 1 <= emergency.detail <= bus.channels:
            return
        key = f"{bus.name}.{emergency.detail}", pe
        if emergency.code is not FaultCode.CHANNEL_LOST:
            self._forget(key)
            return
        if key not in self._told_ns:
            self._turn.emit(events.ChannelLost, channel=key[0], by=pe)
        self._told_ns[key] = self._turn.now_ns

    def beat(self) -> None:
        """Forget each report of a lost channel that its PE has not repeated for CHANNEL_FORGOTTEN_NS."""
        for key in [key for key, at_ns in self._told_ns.items() if self._turn.now_ns - at_ns > CHANNEL_FORGOTTEN_NS]:
            self._forget(key)

    def lost_by(self) -> dict[str, list[str]]:
        """Return, for each channel of a replicated bus, the nodes that hear nothing on it, in the spec's order."""
        witnesses = (OWN, *self._spec.pes)
        return {
            channel: [by for by in witnesses if (channel, by) in self._told_ns or (by == OWN and channel in self._own)]
            for bus in self._spec.buses.values()
            if bus.channels > 1
            for channel in (f"{bus.name}.{number}" for number in range(1, bus.channels + 1))
        }

    def _forget(self, key: tuple[str, str]) -> None:
        if self._told_ns.pop(key, None) is not None:
            self._turn.emit(events.ChannelBack, channel=key[0], by=key[1])
