"""The topic SDO errors: messages out of place, and transfers that the client does not continue."""

from heronry_tools.sim.world.inspection.topic import MS, Topic, demand
from heronry_tools.sim.world.sdo_talk import Talk
from heronry_wire.canopen_objects import DEVICE_NAME, HEARTBEAT_MS, HEARTBEAT_TIME, STORED_EDS
from heronry_wire.identifiers import sdo_response_id
from heronry_wire.sdo import (
    ABORT,
    BLOCK_DOWNLOAD,
    BLOCK_INITIATE,
    BLOCK_START,
    BLOCK_UPLOAD,
    DOWNLOAD,
    DOWNLOAD_ANSWER,
    EXPEDITED,
    SEGMENT_DOWNLOAD,
    SEGMENT_UPLOAD,
    TOGGLE,
    UPLOAD,
    Abort,
    segment,
    with_data,
    with_number,
)


class Transfers(Topic):
    """Makes mistakes in SDO transfers, and verifies that each one is answered with the right abort code."""

    def mistakes(self) -> Talk[None]:
        """Demand that the server refuses a message out of place, and that such a message ends the transfer under way.

        Also demand that the server aborts a transfer that the client does not continue.
        """
        sdo = self._sdo
        first, next_one = with_data(UPLOAD, STORED_EDS, 0), segment(SEGMENT_UPLOAD, b"")
        yield from sdo.refused(segment(SEGMENT_UPLOAD, b""), Abort.COMMAND)
        yield from sdo.refused(segment(SEGMENT_DOWNLOAD, b""), Abort.COMMAND)
        yield from sdo.refused(segment(BLOCK_UPLOAD | BLOCK_START, b""), Abort.COMMAND)
        yield from sdo.refused(segment(BLOCK_DOWNLOAD | 1, b""), Abort.COMMAND)
        yield from sdo.refused(with_data(7 << 5, DEVICE_NAME, 3), Abort.COMMAND, DEVICE_NAME, 3)
        yield from sdo.ask(first)
        yield from sdo.refused(segment(SEGMENT_UPLOAD | TOGGLE, b""), Abort.TOGGLE, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.ask(next_one)
        yield from sdo.refused(next_one, Abort.TOGGLE, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.refused(segment(SEGMENT_DOWNLOAD, b""), Abort.COMMAND, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.say(segment(ABORT, b""))
        yield from sdo.refused(next_one, Abort.COMMAND)
        yield from sdo.say(b"\x40\x00\x10\x00\x00\x00\x00")  # a request must have eight bytes
        yield from sdo.ask(first)
        yield from self._given_up(STORED_EDS)
        yield from sdo.ask(with_data(BLOCK_UPLOAD | BLOCK_INITIATE, STORED_EDS, 0, b"\x05"))
        yield from self._given_up(STORED_EDS)
        half = with_data(DOWNLOAD | EXPEDITED, HEARTBEAT_TIME, 0, HEARTBEAT_MS.to_bytes(4, "little"))
        answer = yield from sdo.ask(half)  # without a length in the request, the object's length counts
        demand(
            answer == with_data(DOWNLOAD_ANSWER, HEARTBEAT_TIME, 0),
            f"a write of half a word is answered with {answer!r}",
        )

    def _given_up(self, index: int) -> Talk[None]:
        """Demand that the server aborts a transfer after a second if the client does not continue it."""
        answer = yield None, sdo_response_id(self._node), 900 * MS
        demand(answer is None, "the server does not wait for a second")
        answer = yield None, sdo_response_id(self._node), 110 * MS
        demand(
            answer == with_number(ABORT, index, 0, Abort.TIME_OUT.value),
            f"a transfer that is not continued is answered with {answer.hex(' ') if answer else answer}",
        )
