"""The data frames of this PE: outputs of its modules, and echoes of the values to which it commanded its actuators.

Every identifier has its own message code, incremented with each frame that is sent. This file only makes frames; the
slice and protocol rule 6 decide which of them are sent. The output echo shows on the bus, with a lower priority than
all data, to which value an actuator was commanded. Observers and simulated plants read the echo:

    byte 0  node-ID   1  FLOAT   2  index of the device in the spec   3  message code   4..7  the value

A module that serves a function may have no such echo: it drives no actuator, or its output to the actuator is no number
(text on a display). Then another frame under the same identifier shows that the module runs:

    byte 0  node-ID   1  ULONG   2  index of its mode                 3  message code   4..7  index of the module

Both frames have 8 bytes, since a DBC file gives one length for each identifier.

A value that the variable's type cannot carry raises WireError; the caller then counts the module as failed.
"""

from collections import defaultdict

from heronry_agent.core.table_index import TableIndex
from heronry_agent.module import Value
from heronry_wire.canaerospace import DataType, Datum, Status, Validity, decode_data, encode_data, pack_status
from heronry_wire.capacities import MOST_DEVICES
from heronry_wire.frame import Frame, Malformed, WireError
from heronry_wire.identifiers import PE_NODES, actuator_echo_id

ECHO_NODES = {actuator_echo_id(node): node for node in PE_NODES}
_VALID = {version: pack_status(Status(version, Validity.VALID)) for version in range(1, 16)}  # byte 2 of a datum


class Publisher:
    """Makes the data frames and output echoes of one PE, with their message codes."""

    def __init__(self, index: TableIndex) -> None:
        self._index = index
        self._codes: defaultdict[int, int] = defaultdict(int)

    def datum(self, source: int, version: int, value: Value) -> Frame:
        """Make the data frame of a source, with the source's next message code.

        Raises WireError if the value does not fit the type of the variable.
        """
        data_type = self._index.types[source]
        identifier = self._index.table.sources[source].identifier
        carried = None if data_type is DataType.NODATA else value
        datum = Datum(self._index.node, data_type, _VALID[version], self._codes[identifier], carried)
        return encode_data(identifier, datum)

    def sent(self, frame: Frame) -> None:
        """Note that a data frame is sent: increment the message code of its identifier."""
        self._codes[frame.can_id] = (self._codes[frame.can_id] + 1) % 256

    def output_echo(self, module: int, mode: int) -> Frame:
        """Make the output echo that shows that an output module has computed a step in this mode."""
        return self._own_echo(DataType.ULONG, mode, module)

    def echo(self, device: str, value: object) -> Frame | None:
        """Make the output echo of the value to which a device was commanded; None if no frame can carry the value."""
        position = self._index.device_index.get(device)
        if position is None or position >= MOST_DEVICES or not isinstance(value, (int, float)):
            return None
        try:
            return self._own_echo(DataType.FLOAT, position, value)
        except WireError:
            return None

    def _own_echo(self, data_type: DataType, service_code: int, value: Value) -> Frame:
        identifier = actuator_echo_id(self._index.node)
        datum = Datum(self._index.node, data_type, service_code, self._codes[identifier], value)
        frame = encode_data(identifier, datum)
        self.sent(frame)
        return frame

    def heard(self, frame: Frame) -> tuple[str, float] | None:
        """Decode another PE's output echo into (device, value).

        None: the frame is no echo, or its sender does not have the device.
        """
        datum = decode_data(frame)
        if isinstance(datum, Malformed) or datum.data_type != DataType.FLOAT:
            return None
        devices = self._index.table.devices
        if datum.service_code >= len(devices) or datum.node_id != ECHO_NODES.get(frame.can_id):
            return None
        device = devices[datum.service_code]
        if device.node != datum.node_id or not isinstance(datum.value, float):
            return None
        return device.name, datum.value
