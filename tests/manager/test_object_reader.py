"""The manager's SDO client: it leaves a PE to another client, and reads an object anew that had no value."""

from heronry_manager.core.sdo_client.object_reader import SILENCE_NS, ObjectReader
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

    def wants(self, node: int, sub_index: int, now_ns: int, tries: int = 1) -> None:
        self.read(node, COUNTERS, sub_index, self.values.append, now_ns, tries=tries)

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
    reader.give_up()
    assert (reader.values, reader.next_ns, reader.sent) == ([None], NEVER_NS, [])


def test_an_object_is_tried_as_often_as_its_caller_allows_and_others_meanwhile() -> None:
    reader, times_ns = Reader(), [0]
    reader.wants(LEFT, 3, 0, tries=3)
    reader.wants(RIGHT, 4, 0)
    while reader.next_ns != NEVER_NS:
        times_ns.append(reader.next_ns)
        reader.tick(reader.next_ns)
    assert reader.sent == [(LEFT, 3), (RIGHT, 4), (LEFT, 3), (LEFT, 3)]
    assert [t_ns // SILENCE_NS for t_ns in times_ns] == [0, 1, 2, 3, 4, 5]
    assert reader.values == [None, None]


def test_a_late_answer_is_dropped_before_the_next_try_and_may_count_in_it() -> None:
    reader = Reader()
    reader.wants(LEFT, 3, 0, tries=3)
    reader.tick(SILENCE_NS)
    reader.answered(LEFT, 3, SILENCE_NS + 1 * MS)
    assert (reader.values, reader.next_ns) == ([], 2 * SILENCE_NS)
    reader.tick(2 * SILENCE_NS)
    for _ in range(2):  # the second one is doubled
        reader.answered(LEFT, 3, 2 * SILENCE_NS + 1 * MS)
    assert (reader.values, len(reader.sent), reader.next_ns) == ([b"\1\0\0\0"], 2, NEVER_NS)


def test_a_newer_request_takes_the_place_of_another_try() -> None:
    reader = Reader()
    reader.wants(LEFT, 3, 0, tries=3)
    reader.tick(SILENCE_NS)
    reader.wants(LEFT, 3, SILENCE_NS + 1 * MS, tries=3)
    assert (reader.values, len(reader.sent)) == ([None], 2)
    reader.wants(LEFT, 3, SILENCE_NS + 2 * MS, tries=3)  # while the object is being read
    reader.tick(reader.next_ns)
    assert (reader.values, len(reader.sent)) == ([None] * 2, 3)
    reader.answered(LEFT, 3, 3 * SILENCE_NS)
    assert (reader.values[2:], len(reader.sent), reader.next_ns) == ([b"\1\0\0\0"], 3, NEVER_NS)


def test_another_try_that_another_client_interrupts_is_made_anew() -> None:
    reader = Reader()
    reader.wants(LEFT, 3, 0, tries=2)
    reader.tick(SILENCE_NS)
    reader.tick(2 * SILENCE_NS)
    reader.heard_other(LEFT, 2 * SILENCE_NS + 1 * MS)
    reader.tick(3 * SILENCE_NS + 1 * MS)
    assert (len(reader.sent), reader.values) == (3, [])
    reader.tick(reader.next_ns)
    assert (len(reader.sent), reader.values, reader.next_ns) == (3, [None], NEVER_NS)


def test_a_manager_that_is_no_longer_active_makes_no_other_try() -> None:
    reader = Reader()
    reader.wants(LEFT, 3, 0, tries=3)
    reader.wants(RIGHT, 4, 0, tries=3)
    reader.tick(SILENCE_NS)
    reader.give_up()
    assert (reader.values, reader.next_ns) == ([None, None], NEVER_NS)
