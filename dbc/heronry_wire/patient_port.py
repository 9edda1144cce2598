"""A second opening of a node's bus, by which frames come that wake nobody.

Most frames of a busy bus are data, and a module reads its data when it is stepped. So a node need not wake for each of
them: the kernel (or the hub of a software bus) keeps them until the node wakes for something else. A descriptor is
readable whatever frame has come; so these frames need a socket of their own, on which no `select` waits.

    the node's bus    what may change a deadline: commands, states, echoes of own frames
    this port         the identifiers that the node calls *patient*. `read` takes what has come, at each turn of the
                      node's loop, and at the latest PATIENCE_NS after the last turn: so long a full bus of 1 Mbit/s
                      fits into SocketCAN's usual buffer

An identifier may be accepted by both for a moment, while filters change: then its frame comes twice, as a datum may. If
this port fails, `heronry_wire.link` treats the bus as lost.
"""

from collections.abc import Collection, Mapping
from typing import Any

from heronry_wire.bare_can import can
from heronry_wire.bus_opening import open_bus
from heronry_wire.frame_port import Arrival, port_of
from heronry_wire.python_can import frames_dropped

PATIENCE_NS = 20_000_000
_NONE: can.typechecking.CanFilters = [
    {"can_id": 0x1FFF_FFFF, "can_mask": 0x1FFF_FFFF, "extended": True}
]  # no filter at all would accept all frames


class PatientPort:
    """The frames of a bus for which nobody waits."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        """Open the bus that these keyword arguments of `can.Bus` describe once more; raises LinkError.

        The bus is on SocketCAN or a software bus, whose descriptors tell when nothing is left to read.
        """
        self._bus = open_bus({**config, "receive_own_messages": False}).bus
        try:
            self._bus.set_filters(_NONE)
            self._port = port_of(self._bus, has_nothing_left=lambda: True, noise=lambda: None)
        except Exception:
            self._bus.shutdown()
            raise

    def accept(self, identifiers: Collection[int]) -> None:
        """From now on receive only frames with these 11-bit identifiers."""
        exact: can.typechecking.CanFilters = [
            {"can_id": one, "can_mask": 0x7FF, "extended": False} for one in sorted(identifiers)
        ]
        self._bus.set_filters(exact or _NONE)

    @property
    def dropped(self) -> int:
        """How many frames this opening has lost, since nobody read them in time."""
        return frames_dropped(self._bus)

    def read(self, now_ns: int, most: int) -> tuple[list[Arrival], bool]:
        """Read frames as `FramePort.read` does; error frames, which the node's bus reports, are left out."""
        read, has_more = self._port.read(now_ns, most)
        return [arrival for arrival in read if not arrival.frame.error], has_more

    def close(self) -> None:
        """Close this opening of the bus."""
        self._bus.shutdown()
