"""The data frames of this PE: the outputs of its modules, and the values to which its actuators were commanded.

Every identifier has its own message code, incremented with each frame that is sent. The slice says which frames go out,
and protocol rule 6 may forbid them; this file only makes them. The output echo is for an observer: it shows on the bus,
with a lower priority than all data, what an output does, and a plant follows it.

    byte 0  node-ID   1  FLOAT   2  index of the device in the spec   3  message code   4..7  the value

For a module that serves a function but drives no actuator, or writes to its actuator what is not a number (text on a
display), a frame under the same identifier shows that it runs:

    byte 0  node-ID   1  ULONG   2  index of its mode                 3  message code   4..7  index of the module

Both frames have 8 bytes: in a DBC a frame has one length.

A value that its type cannot carry raises WireError: the module that gave the value has failed.
"""

from collections import defaultdict

from heronry_agent.core.table_index import TableIndex
from heronry_agent.module import Value
from heronry_wire.canaerospace import DataType, Datum, Status, Validity, decode_data, encode_data, pack_status
from heronry_wire.frame import Frame, Malformed, WireError
from heronry_wire.identifiers import PE_NODES, actuator_echo_id

ECHO_NODES = {actuator_echo_id(node): node for node in PE_NODES}
_VALID = {version: pack_status(Status(version, Validity.VALID)) for version in range(1, 16)}  # byte 2 of a datum


class Publisher:
    """Makes data and echo frames."""

    def __init__(self, index: TableIndex) -> None:
        self._index = index
        self._codes: defaultdict[int, int] = defaultdict(int)

    def datum(self, source: int, version: int, value: Value) -> Frame:
        """Frame of a source, with the message code that comes next; raises WireError."""
        data_type = self._index.types[source]
        identifier = self._index.table.sources[source].identifier
        carried = None if data_type is DataType.NODATA else value
        datum = Datum(self._index.node, data_type, _VALID[version], self._codes[identifier], carried)
        return encode_data(identifier, datum)

    def sent(self, frame: Frame) -> None:
        """A data frame goes out: increment the message code of its identifier."""
        self._codes[frame.can_id] = (self._codes[frame.can_id] + 1) % 256

    def output_echo(self, module: int, mode: int) -> Frame:
        """Echo of a step of an output that commands no actuator to a number."""
        return self._own_echo(DataType.ULONG, mode, module)

    def echo(self, device: str, value: object) -> Frame | None:
        """Echo of a value written to a device; None where the value is not a number that a frame can carry."""
        position = self._index.device_index.get(device)
        if position is None or position > 255 or not isinstance(value, (int, float)):
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
        """Read another PE's echo: device and value; None where the frame is not an echo of a device of that PE."""
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
