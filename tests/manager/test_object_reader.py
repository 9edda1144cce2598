"""The manager's SDO client beside another one: it leaves a PE to the other client."""

from heronry_manager.core.object_reader import SILENCE_NS, ObjectReader
from heronry_wire.canopen_objects import COUNTERS
from heronry_wire.identifiers import sdo_request_id
from heronry_wire.sansio import NEVER_NS, Send
from heronry_wire.sdo import EXPEDITED, SIZE_GIVEN, UPLOAD_ANSWER, read_head, with_data

LEFT, RIGHT = 92, 93
MS = 1_000_000


class Reader(ObjectReader):
    """A reader with what it has sent, as node and sub-index, and what it has read."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, int]] = []
        self.values: list[bytes | None] = []
        super().__init__(self._send)

    def _send(self, sent: Send) -> None:
        self.sent.append((sent.frame.can_id - sdo_request_id(LEFT) + LEFT, read_head(sent.frame.data)[1]))

    def wants(self, node: int, sub_index: int, now_ns: int) -> None:
        self.read(node, COUNTERS, sub_index, self.values.append, now_ns)

    def answered(self, node: int, sub_index: int, now_ns: int) -> None:
        command = UPLOAD_ANSWER | EXPEDITED | SIZE_GIVEN
        self.heard(node, with_data(command, COUNTERS, sub_index, b"\1\0\0\0"), now_ns)


def test_a_pe_is_left_to_another_client_until_that_has_been_silent() -> None:
    reader = Reader()
    reader.heard_other(LEFT, 5 * MS)
    reader.wants(LEFT, 3, 6 * MS)
    reader.heard_other(LEFT, 7 * MS)
    assert (reader.sent, reader.next_ns) == ([], 7 * MS + SILENCE_NS)
    reader.tick(reader.next_ns - 1)
    assert reader.sent == []
    reader.tick(reader.next_ns)
    reader.answered(LEFT, 3, 8 * MS + SILENCE_NS)
    assert (reader.sent, reader.values, reader.next_ns) == ([(LEFT, 3)], [b"\1\0\0\0"], NEVER_NS)


def test_what_another_client_interrupts_is_read_anew_and_other_pes_meanwhile() -> None:
    reader = Reader()
    reader.wants(LEFT, 3, 0)
    reader.wants(RIGHT, 4, 0)
    reader.heard_other(LEFT, 1 * MS)
    reader.answered(LEFT, 3, 2 * MS)  # to the other client
    assert (reader.sent, reader.values) == ([(LEFT, 3), (RIGHT, 4)], [])
    reader.answered(RIGHT, 4, 3 * MS)
    assert (len(reader.values), reader.next_ns) == (1, 1 * MS + SILENCE_NS)
    reader.tick(reader.next_ns)
    assert reader.sent == [(LEFT, 3), (RIGHT, 4), (LEFT, 3)]


def test_a_manager_that_is_no_longer_active_waits_for_no_pe() -> None:
    reader = Reader()
    reader.heard_other(LEFT, 0)
    reader.wants(LEFT, 3, 0)
    reader.give_up(1)
    assert (reader.values, reader.next_ns, reader.sent) == ([None], NEVER_NS, [])
