"""Driver `canaerospace`: a datum of a CANaerospace node that is no PE, on a bus of this PE.

The driver only listens. A frame counts if it has the identifier, and the node-ID in byte 0. Its value is the reading.
These make that there is none: silence (by `stale_ms`), a frame of type NODATA or ERROR, a service code (byte 2) that
the option `invalid_codes` lists, and an emergency event of the node, for `quiet_ms` after it.
"""

import time
from typing import Any, ClassVar

from heronry_agent.device_driver import Measured, Option, OptionError, SensorDriver, Setup
from heronry_wire.bare_can import can
from heronry_wire.canaerospace import DataType, decode_data
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import emergency_event_id
from heronry_wire.python_can import frame_of

_WAIT_S = 0.2
_NS_PER_MS = 1_000_000


class ForeignDatum:
    """Makes readings of the frames of a foreign node."""

    def __init__(self, node: int, identifier: int, invalid_codes: tuple[int, ...] = (), quiet_ns: int = 0) -> None:
        self._node, self._identifier, self._invalid, self._quiet_ns = node, identifier, invalid_codes, quiet_ns
        self._quiet_until_ns = 0

    @property
    def identifiers(self) -> tuple[int, ...]:
        """The identifiers of the frames that matter."""
        return self._identifier, emergency_event_id(self._node)

    def hear(self, frame: Frame, now_ns: int) -> Measured | None:
        """Take a frame; returns the reading that it gives, or None."""
        datum = decode_data(frame)
        if frame.extended or isinstance(datum, Malformed) or datum.node_id != self._node:
            return None
        if frame.can_id == emergency_event_id(self._node):
            self._quiet_until_ns = now_ns + self._quiet_ns
            return None
        if frame.can_id != self._identifier or datum.service_code in self._invalid or now_ns < self._quiet_until_ns:
            return None
        if datum.data_type in (DataType.NODATA, DataType.ERROR) or datum.value is None:
            return None
        return Measured(datum.value, now_ns)


class ForeignNode(SensorDriver):
    """A datum of a foreign node, heard on a bus of this PE."""

    OPTIONS: ClassVar = {
        "node": Option("CANaerospace node-ID of the foreign node.", int, least=1, most=255),
        "identifier": Option("Identifier of the datum.", int, least=1, most=2031),
        "bus": Option("Bus of this PE, by its name in the spec; the one toward the manager if left out.", str, ""),
        "invalid_codes": Option("Service codes with which the node marks a datum that must not be used.", list, ()),
        "quiet_ms": Option("For how long after an emergency event no datum is used, in ms.", int, 1_000, least=0),
    }
    WAITS: ClassVar = True

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        name = options["bus"] or setup.uplink
        if name not in setup.buses:
            raise OptionError(f"option 'bus' names no bus of this PE: {name}; there is {', '.join(setup.buses)}")
        self._datum = ForeignDatum(
            options["node"], options["identifier"], tuple(options["invalid_codes"]), options["quiet_ms"] * _NS_PER_MS
        )
        filters = [{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in self._datum.identifiers]
        self._bus: Any = can.Bus(**{**setup.buses[name], "can_filters": filters})

    def read(self) -> Measured | None:
        """Wait for a frame."""
        message = self._bus.recv(_WAIT_S)
        if message is None or message.is_error_frame or message.is_remote_frame:
            return None
        return self._datum.hear(frame_of(message), time.monotonic_ns())

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
