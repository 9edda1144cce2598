"""The SDO server with an unmodified `canopen` client, and with a client that makes every mistake (CiA 301, 7.2.4)."""

import queue
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import pytest
from canopen import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoError
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.canopen_master import refusal
from heronry_agent.core.canopen import SdoServer
from heronry_agent.core.canopen.sdo_server import SEGMENTS_PER_BLOCK, TIME_OUT_NS
from heronry_wire.sansio import NEVER_NS
from heronry_wire.sdo import Abort, abort_message
from thoroughness import part_of

MS = 1_000_000
SEGMENT_NS = 300_000
NUMBER, TEXT, DOMAIN, FIXED, NOTHING, PICKY = range(0x2000, 0x2006)
ROOM = 4_000

lengths = st.one_of(st.integers(0, 30), st.sampled_from([32 * 7, 127 * 7]).flatmap(lambda n: st.integers(n - 8, n + 8)))
contents = lengths.flatmap(lambda length: st.binary(min_size=length, max_size=length))


@dataclass
class Shelf:
    """A few objects: a number of four bytes, a text, a domain, one that is read only, one without bytes."""

    values: dict[int, bytes] = field(
        default_factory=lambda: {NUMBER: b"\1\2\3\4", TEXT: b"a text", DOMAIN: b"", FIXED: b"fixed", NOTHING: b""}
    )

    def read(self, index: int, sub_index: int) -> bytes | Abort:
        if index not in self.values:
            return Abort.NO_OBJECT
        return self.values[index] if sub_index == 0 else Abort.NO_SUB_INDEX

    def room(self, index: int, sub_index: int, length: int | None) -> int | Abort:
        found = self.read(index, sub_index)
        if index == PICKY:
            return ROOM
        if isinstance(found, Abort):
            return found
        if index == FIXED:
            return Abort.READ_ONLY
        if index == NUMBER:
            return 4 if length in (None, 4) else Abort.LENGTH
        return ROOM if length is None or length <= ROOM else Abort.OUT_OF_MEMORY

    def write(self, index: int, _sub_index: int, data: bytes) -> Abort | None:
        if index == PICKY:
            return Abort.VALUE
        if index == NUMBER and len(data) != 4:
            return Abort.LENGTH
        self.values[index] = data
        return None


class Line:
    """A server and its time, and a `canopen` client on it; frames can be lost on the way, by their number."""

    def __init__(self) -> None:
        self.shelf = Shelf()
        self.server = SdoServer(self.shelf, SEGMENT_NS)
        self.now_ns = 0
        self.lost_requests: set[int] = set()
        self.lost_answers: set[int] = set()
        self.requests = self.answers = 0
        self.heard: deque[bytes] = deque()
        self.client = SdoClient(0x65C, 0x5DC, ObjectDictionary())
        self.client.network = self  # type: ignore[assignment]
        self.client.responses = self  # type: ignore[assignment]

    def send_message(self, _can_id: int, data: bytes) -> None:
        """Send a frame of the client to the server, in place of its bus."""
        self.requests += 1
        if self.requests not in self.lost_requests:
            self._answer(self.ask(bytes(data)))

    def get(self, *, block: bool, timeout: float) -> bytes:
        """Return the next answer, in place of the client's queue; waits in the server's time."""
        assert block
        end_ns = self.now_ns + round(timeout * 1000 * MS)
        while not self.heard and self.server.next_ns <= end_ns:
            for answer in self.pass_time(self.server.next_ns - self.now_ns):
                self._answer(answer)
        if not self.heard:
            self.now_ns = end_ns
            raise queue.Empty
        return self.heard.popleft()

    def empty(self) -> bool:
        """Tell that no frame waits: the client, too, ignores frames that it did not request."""
        self.heard.clear()
        return True

    def _answer(self, answer: bytes | None) -> None:
        if answer is not None:
            self.answers += 1
            if self.answers not in self.lost_answers:
                self.heard.append(answer)

    def ask(self, message: bytes) -> bytes | None:
        self.now_ns += MS // 10
        return self.server.request(message, self.now_ns)

    def pass_time(self, duration_ns: int) -> Iterator[bytes]:
        """Let time pass; gives the answers of the server meanwhile."""
        end_ns = self.now_ns + max(0, duration_ns)
        while self.server.next_ns <= end_ns:
            self.now_ns = max(self.now_ns, self.server.next_ns)
            answer = self.server.tick(self.now_ns)
            if answer is not None:
                yield answer
        self.now_ns = end_ns

    def is_idle(self) -> bool:
        return self.server.next_ns == NEVER_NS


@pytest.fixture
def line() -> Line:
    return Line()


def aborted(answer: bytes | None) -> Abort:
    """Reason of an abort."""
    assert answer is not None
    assert answer[0] == 0x80
    return Abort(int.from_bytes(answer[4:], "little"))


def message(text: str) -> bytes:
    return bytes.fromhex(text).ljust(8, b"\0")


# An unmodified client


@given(contents)
def test_a_client_writes_and_reads_by_segments(content: bytes) -> None:
    line = Line()
    line.client.download(DOMAIN, 0, content)
    assert line.shelf.values[DOMAIN] == content
    assert line.client.upload(DOMAIN, 0) == content
    assert line.is_idle()


@given(contents.filter(bool))  # the client cannot send nothing
def test_a_client_writes_and_reads_by_blocks(content: bytes) -> None:
    line = Line()
    with line.client.open(DOMAIN, 0, "wb", size=len(content), block_transfer=True, buffering=7) as stream:
        stream.write(content)
    assert line.shelf.values[DOMAIN] == content
    with line.client.open(DOMAIN, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == content
    assert line.is_idle()


def test_nothing_can_be_read_by_block(line: Line) -> None:
    with line.client.open(NOTHING, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == b""
    assert line.is_idle()


def test_a_client_does_without_checksum_and_without_size(line: Line) -> None:
    content = bytes(range(200))
    with line.client.open(
        DOMAIN, 0, "wb", size=len(content), block_transfer=True, request_crc_support=False, buffering=7
    ) as stream:
        stream.write(content)
    assert line.shelf.values[DOMAIN] == content
    with line.client.open(DOMAIN, 0, "rb", block_transfer=True, request_crc_support=False) as stream:
        assert stream.read() == content
    with line.client.open(TEXT, 0, "wb", buffering=7) as stream:
        stream.write(b"as long as it gets")
    assert line.shelf.values[TEXT] == b"as long as it gets"


@given(st.sets(st.integers(2, SEGMENTS_PER_BLOCK + 1), min_size=1, max_size=5))
def test_segments_of_a_block_that_are_lost_are_sent_again(lost: set[int]) -> None:
    """Except in the last block: the client does not send again what it takes for complete."""
    line = Line()
    line.lost_requests = lost
    content = bytes(range(256)) * 2
    with line.client.open(DOMAIN, 0, "wb", size=len(content), block_transfer=True, buffering=7) as stream:
        stream.write(content)
    assert line.shelf.values[DOMAIN] == content


def test_what_is_not_there_or_not_allowed_is_said(line: Line) -> None:
    client = line.client
    for index, sub_index, code in ((0x3000, 0, 0x0602_0000), (TEXT, 7, 0x0609_0011)):
        assert refusal(partial(client.upload, index, sub_index)) == code
        assert refusal(partial(client.download, index, sub_index, b"12345")) == code
    for content in (b"x", b"longer than four", b""):
        assert refusal(partial(client.download, FIXED, 0, content)) == 0x0601_0002
    assert refusal(lambda: client.download(NUMBER, 0, b"\1\2")) == 0x0607_0010
    assert refusal(lambda: client.download(PICKY, 0, b"a long value")) == 0x0609_0030
    assert refusal(lambda: client.download(DOMAIN, 0, bytes(ROOM + 1))) == 0x0504_0005
    for block in ("rb", "wb"):
        assert refusal(partial(client.open, 0x3000, 0, block, size=9, block_transfer=True)) == 0x0602_0000
    assert line.is_idle()
    assert line.shelf == Shelf()


def test_an_answer_that_is_lost_leaves_nothing_behind(line: Line) -> None:
    line.lost_answers = {3}
    with pytest.raises(SdoError):
        line.client.download(DOMAIN, 0, bytes(40))
    assert line.is_idle()
    line.client.download(DOMAIN, 0, b"once more, with feeling")
    assert line.shelf.values[DOMAIN] == b"once more, with feeling"


# A client that makes every mistake


def test_reading_nothing_takes_one_empty_segment(line: Line) -> None:
    assert line.ask(message("40 0420 00")) == message("41 0420 00")
    assert line.ask(message("60")) == message("0f")
    assert line.is_idle()


def test_a_value_that_never_ends_is_cut_off(line: Line) -> None:
    line.ask(message("20 0220 00"))
    answers = [line.ask(bytes((toggle,)) + b"endless") for toggle in (0x00, 0x10) * ROOM]
    assert answers[ROOM // 7] == abort_message(DOMAIN, 0, Abort.LENGTH)
    line.ask(message("c0 0220 00"))
    line.shelf.values[DOMAIN] = b"before"
    numbers = list(range(1, SEGMENTS_PER_BLOCK + 1)) * (ROOM // 7)
    assert abort_message(DOMAIN, 0, Abort.LENGTH) in [line.ask(bytes((number,)) + b"endless") for number in numbers]
    assert line.shelf.values[DOMAIN] == b"before"


def test_of_two_clients_the_later_one_is_served(line: Line) -> None:
    line.ask(message("21 0220 00 0e"))
    assert line.ask(message("40 0120 00")) == message("41 0120 00 06")
    assert aborted(line.ask(message("00 31323334353637"))) is Abort.COMMAND  # the first one goes on
    assert aborted(line.ask(message("60"))) is Abort.COMMAND  # and so the second one has to begin anew
    assert line.shelf == Shelf()


requests = st.one_of(
    st.binary(max_size=9),
    st.binary(min_size=8, max_size=8),
    st.builds(
        lambda command, index, rest: bytes((command,)) + index.to_bytes(2, "little") + b"\0" + rest,
        st.sampled_from([0x20, 0x21, 0x22, 0x23, 0x2F, 0x40, 0xC0, 0xC2, 0xC6, 0xA0, 0xA4]),
        st.integers(NUMBER, PICKY),
        st.one_of(st.binary(min_size=4, max_size=4), st.just(b"\x0e\0\0\0")),
    ),
    st.builds(
        lambda command, data: bytes((command,)) + data,
        st.sampled_from([0x00, 0x10, 0x01, 0x11, 0x60, 0x70, 0xA1, 0xA2, 0xA3, 0xC1, 0xD1, 0x81, 0x82, 1, 2, 3]),
        st.binary(min_size=7, max_size=7),
    ),
)


@settings(max_examples=part_of(300))
@given(st.lists(st.one_of(requests, st.integers(0, 2 * TIME_OUT_NS)), max_size=40))
def test_whatever_comes_is_answered_with_at_most_one_frame_and_harms_nothing(story: list[bytes | int]) -> None:
    line = Line()
    for happening in story:
        if isinstance(happening, int):
            answers: list[bytes | None] = list(line.pass_time(happening))
        else:
            answers = [line.ask(happening)]
        assert all(answer is None or len(answer) == 8 for answer in answers)
        assert line.server.next_ns == NEVER_NS or line.server.next_ns <= line.now_ns + TIME_OUT_NS
    assert line.shelf.values[FIXED] == b"fixed"
    assert len(line.shelf.values[NUMBER]) == 4
    list(line.pass_time(2 * TIME_OUT_NS))
    assert line.is_idle()
