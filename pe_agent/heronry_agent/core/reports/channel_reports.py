"""Reports of this PE on its replicated buses: which channel is lost, that is, brings no frames (protocol rule 8).

A replicated bus has two channels, which carry the same frames. The driver finds out which channel is lost
(`ChannelsLost`). This file reports it to the manager, by EMCY:

    lost    CHANNEL_LOST immediately, and again every second while the channel is lost
    back    CHANNEL_BACK, once

The manager does not acknowledge these reports. They change no plan, since the bus itself still carries frames. The
manager also counts a channel as back when no PE has reported its loss for three seconds. From this follows:

    a CHANNEL_LOST is not received        the manager learns of the loss one second later
    a CHANNEL_BACK is not received        the manager learns of the return within three seconds
    the manager restarts or takes over    it learns of a lost channel within one second
    the reporting PE fails                its reports expire after three seconds
"""

from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_REPORT_NS
from heronry_wire.sansio import NEVER_NS, Send

_NO_ERROR, _COMMUNICATION_ERROR = 0x00, 0x11  # CiA 301 object 1001h: bit 0 generic, bit 4 communication


class ChannelReports:
    """Reports the lost channels of one PE's replicated buses; `next_ns` is the time at which to call `tick`."""

    def __init__(self, turn: Turn, index: TableIndex) -> None:
        self._turn, self._index = turn, index
        self.next_ns = NEVER_NS
        self._emcy_id = emcy_id(index.node)
        self._lost: set[tuple[int, int]] = set()  # port, channel

    def told(self, port: int, lost: frozenset[int]) -> None:
        """Report to the manager which channels of a port have become lost or have come back.

        lost: all channels of the port that are lost now, numbered from 1.
        """
        self._note(self._index.table.ports[port].bus, lost)
        now_lost = {(port, channel) for channel in lost}
        back = sorted(one for one in self._lost - now_lost if one[0] == port)
        found = sorted(now_lost - self._lost)
        self._lost.difference_update(back)
        self._lost.update(found)
        self.next_ns = self._turn.now_ns + CHANNEL_REPORT_NS if self._lost else NEVER_NS
        for one in back:
            self._say(FaultCode.CHANNEL_BACK, _NO_ERROR, *one)
        for one in found:
            self._say(FaultCode.CHANNEL_LOST, _COMMUNICATION_ERROR, *one)

    def tick(self) -> None:
        """Report again each channel that is still lost."""
        self.next_ns = self._turn.now_ns + CHANNEL_REPORT_NS
        for one in sorted(self._lost):
            self._say(FaultCode.CHANNEL_LOST, _COMMUNICATION_ERROR, *one)

    def _note(self, bus: str, lost: frozenset[int]) -> None:
        names = ", ".join(f"{bus}.{channel}" for channel in sorted(lost))
        self._turn.note("channel", f"{names} carries nothing here" if lost else f"{bus} has both its channels")

    def _say(self, code: FaultCode, register: int, port: int, channel: int) -> None:
        message = Emergency(code, register, ElementKind.CHANNEL, port, channel)
        self._turn.do(Send(self._index.uplink, Frame(self._emcy_id, message.encode())))
