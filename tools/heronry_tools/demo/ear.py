"""One bus of the spec as whoever watches a flight hears it: each frame once, of a replicated bus from either channel.

A channel that fails is heard no more, and the other one is. A bus that has no channel left is an error of the flight.
"""

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

import can

from heronry_dg.model import Bus
from heronry_tools.demo.buses import BusChoice
from heronry_wire.channel_merge import ChannelMerge
from heronry_wire.frame import Frame
from heronry_wire.link import open_bus


class Ear:
    """Listens to one bus; as a context manager it leaves it at the end."""

    def __init__(self, choice: BusChoice, bus: Bus) -> None:
        """Open every channel; raises LinkError."""
        self._merge = ChannelMerge(bus.heartbeat_ns) if bus.channels > 1 else None
        self._channels: dict[int, can.BusABC] = {}
        for number, config in enumerate(choice.configs()):
            self._channels[number] = open_bus(config)[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for bus in self._channels.values():
            bus.shutdown()

    @property
    def readers(self) -> Sequence[can.BusABC]:
        """What to wait on until something has come."""
        return list(self._channels.values())

    def hear(self) -> Iterator[tuple[float, Frame]]:
        """Give what has come: the time in seconds of the wall clock, and the frame."""
        if self._merge is None:
            for bus in self._channels.values():
                yield from _heard(bus)
            return
        heard = [(*one, channel) for channel in list(self._channels) for one in self._of_channel(channel)]
        for seconds, frame, channel in sorted(heard, key=lambda one: one[0]):
            if self._merge.take(channel, frame, int(seconds * 1e9)):
                yield seconds, frame

    def _of_channel(self, channel: int) -> list[tuple[float, Frame]]:
        heard: list[tuple[float, Frame]] = []
        try:
            heard.extend(_heard(self._channels[channel]))
        except (can.CanError, OSError):
            if len(self._channels) == 1:
                raise
            self._channels.pop(channel).shutdown()
        return heard


def _heard(bus: can.BusABC) -> Iterator[tuple[float, Frame]]:
    while (message := bus.recv(0)) is not None:
        yield (
            message.timestamp,
            Frame(message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame),
        )
