"""How a PE serves its objects by SDO, by segments and by blocks, also to faulty clients (CiA 301, 7.2.4).

Messages are written as they are on the wire; the PE's own codec is not used.
"""

from binascii import crc_hqx
from dataclasses import replace

from heronry_wire.canopen_objects import HEARTBEAT_TIME
from heronry_wire.frame import Frame
from heronry_wire.identifiers import NMT_ID, sdo_request_id, sdo_response_id
from lab.conformance.pe_under_test import NODE, TABLE, PeUnderTest, gaps, moments
from lab.conformance.player import MS, demand, equal

_HEARTBEAT, _TABLE = "17 10 00", "20 20 00"  # index and sub-index, as they are sent
_TOGGLE, _TIME_OUT, _COMMAND = "00 00 03 05", "00 00 04 05", "01 00 04 05"
_BLOCK_SIZE, _SEQUENCE, _CRC, _MEMORY = "02 00 04 05", "03 00 04 05", "04 00 04 05", "05 00 04 05"
_READ_ONLY, _NO_OBJECT, _NO_SUB_INDEX = "02 00 01 06", "00 00 02 06", "11 00 09 06"
_LENGTH = "10 00 07 06"
_ENOUGH_MS = 5  # for an answer, one at a time


class Client:
    """A client of a PE that runs nothing and hears no manager."""

    def __init__(self, pe: PeUnderTest | None = None) -> None:
        self.pe = PeUnderTest() if pe is None else pe
        self.pe.run(5)

    def says(self, request: str) -> int:
        """Send a message; gives its time."""
        self.pe.main.say(Frame(sdo_request_id(NODE), bytes.fromhex(request).ljust(8, b"\0")))
        return self.pe.now_ns

    def asks(self, request: str, within_ms: float = _ENOUGH_MS) -> list[bytes]:
        """Send a message; gives the answers."""
        began_ns = self.says(request)
        self.pe.run(within_ms)
        return self.answers(began_ns)

    def commands(self, command: int) -> None:
        """Give it an NMT command."""
        self.pe.main.say(Frame(NMT_ID, bytes((command, NODE))))
        self.pe.run(_ENOUGH_MS)

    def answers(self, since_ns: int) -> list[bytes]:
        """Return the answers since a moment."""
        return [one.frame.data for one in self.pe.main.since(since_ns, [sdo_response_id(NODE)])]

    def writes_table(self, text: bytes) -> str | None:
        """Write object 2020h by blocks, without a checksum; gives why it is refused, None where it is accepted."""
        self.hears(f"c2 {_TABLE} {len(text).to_bytes(4, 'little').hex()}", f"a0 {_TABLE} 20")
        parts = [text[start : start + 7] for start in range(0, len(text), 7)]
        for position, part in enumerate(parts):
            is_last, number = position + 1 == len(parts), position % 32 + 1
            answers = self.asks(f"{0x80 * is_last | number:02x} {part.hex()}", 1)
            ends = is_last or number == 32
            equal(
                [data[:3].hex(" ") for data in answers], [f"a2 {number:02x} 20"] if ends else [], "answers to a segment"
            )
        (end,) = self.asks(f"{0xC1 | -len(text) % 7 << 2:02x}")
        return end[4:].hex(" ") if end[0] == 0x80 else None

    def hears(self, request: str, answer: str, within_ms: float = _ENOUGH_MS) -> None:
        """Demand one answer."""
        found = [data.hex(" ") for data in self.asks(request, within_ms)]
        equal(found, [bytes.fromhex(answer).ljust(8, b"\0").hex(" ")], f"answers to {request}")

    def is_refused(self, request: str, reason: str) -> None:
        """Demand that a message ends the transfer, with a reason."""
        found = [(data[0], data[4:].hex(" ")) for data in self.asks(request)]
        equal(found, [(0x80, reason)], f"answers to {request}")


def a_number_is_written_in_every_way() -> None:
    """Expedited with and without its length, by segments, and by a block; each time it is the object's value."""
    client = Client()
    client.hears(f"2b {_HEARTBEAT} f4 01", f"60 {_HEARTBEAT}")
    equal(client.pe.object(HEARTBEAT_TIME), 500, "heartbeat written expedited")
    client.hears(f"22 {_HEARTBEAT} f5 01", f"60 {_HEARTBEAT}")
    equal(client.pe.object(HEARTBEAT_TIME), 501, "heartbeat written without a length")
    client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
    client.hears("0b f6 01", "20")
    equal(client.pe.object(HEARTBEAT_TIME), 502, "heartbeat written by a segment")
    client.hears(f"20 {_HEARTBEAT}", f"60 {_HEARTBEAT}")
    client.hears("0c f7", "20")
    client.hears("1d 01", "30")
    equal(client.pe.object(HEARTBEAT_TIME), 503, "heartbeat written by two segments, without a length")
    client.hears(f"c2 {_HEARTBEAT} 02", f"a0 {_HEARTBEAT} 20")
    client.hears("81 f8 01", "a2 01 20")
    client.hears("d5", "a1")
    equal(client.pe.object(HEARTBEAT_TIME), 504, "heartbeat written by a block")


def what_is_wrong_is_refused_with_a_reason() -> None:
    """A wrong request changes nothing; a message after it belongs to no transfer."""
    client = Client()
    for request, reason in (
        (f"2f {_HEARTBEAT} 01", _LENGTH),
        (f"21 {_HEARTBEAT} 03", _LENGTH),
        ("2b 00 10 00 01 00", _READ_ONLY),
        ("2b ff 5f 00 01 00", _NO_OBJECT),
        ("40 ff 5f 00", _NO_OBJECT),
        ("2b 17 10 01 01 00", _NO_SUB_INDEX),
        ("0b f4 01", _COMMAND),
        ("60", _COMMAND),
        ("a3", _COMMAND),
        ("c1", _COMMAND),
        ("e0", _COMMAND),
        (f"c2 {_HEARTBEAT} 03", _LENGTH),
        (f"a0 {_TABLE} 00", _BLOCK_SIZE),
        (f"a0 {_TABLE} 80", _BLOCK_SIZE),
    ):
        client.is_refused(request, reason)
    client.hears(f"20 {_HEARTBEAT}", f"60 {_HEARTBEAT}")
    client.is_refused("0d f4", _LENGTH)  # one byte of a number of two, without a length
    for segment, reason in (("1b f4 01", _TOGGLE), ("0d f4", _LENGTH), ("08 f4 01 00", _LENGTH), ("60", _COMMAND)):
        client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
        client.is_refused(segment, reason)
        client.is_refused("0b f4 01", _COMMAND)
    equal(client.pe.object(HEARTBEAT_TIME), 1000, "heartbeat after what was wrong")


def a_client_may_break_off() -> None:
    """The PE does not answer an abort, nor a message that is too short; the transfer has ended."""
    client = Client()
    client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
    equal(client.asks(f"80 {_HEARTBEAT} 00 00 00 08"), [], "answers to an abort")
    client.is_refused("0b f4 01", _COMMAND)
    client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
    client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")  # a new beginning takes its place
    client.hears("0b f4 01", "20")
    equal(client.pe.object(HEARTBEAT_TIME), 500, "heartbeat at last")


def a_client_that_falls_silent_is_given_up() -> None:
    """The transfer ends after a second without a message, and not before."""
    client = Client()
    for begin, message in ((f"21 {_HEARTBEAT} 02", _HEARTBEAT), (f"40 {_TABLE}", _TABLE), (f"a0 {_TABLE} 02", _TABLE)):
        equal(len(client.asks(begin)), 1, f"answers to {begin}")
        began_ns = client.pe.run(990)
        equal(client.answers(began_ns), [], f"what is said within a second of {begin}")
        began_ns = client.pe.run(10)
        said = [data.hex(" ") for data in client.answers(began_ns)]
        equal(said, [f"80 {message} {_TIME_OUT}"], f"what is said a second after {begin}")
    client.hears(f"21 {_TABLE} 0e", f"60 {_TABLE}")
    client.pe.run(900)
    client.hears("00 31 32 33 34 35 36 37", "20")
    began_ns = client.pe.run(900)
    equal(client.answers(began_ns), [], "what is said 900 ms after a segment")


def a_table_may_have_a_mebibyte() -> None:
    """A byte more is refused before the first one comes. A PE that runs modules takes a table, too, beside its own."""
    client = Client()
    client.hears(f"c6 {_TABLE} 00 00 10 00", f"a4 {_TABLE} 20")
    client.asks("80")
    client.is_refused(f"c6 {_TABLE} 01 00 10 00", _MEMORY)
    client.is_refused(f"21 {_TABLE} 01 00 10 00", _MEMORY)
    client = Client(PeUnderTest().attended().flies())
    client.hears(f"c6 {_TABLE} 00 00 10 00", f"a4 {_TABLE} 20")
    client.asks("80")
    client.is_refused(f"c6 {_TABLE} 01 00 10 00", _MEMORY)


def a_table_is_fetched_by_segments() -> None:
    """Segments have seven bytes, the toggle bit alternates, the last one is marked; a wrong toggle bit ends it."""
    client = Client()
    wanted = client.pe.table.to_json().encode()
    client.hears(f"40 {_TABLE}", f"41 {_TABLE} {len(wanted).to_bytes(4, 'little').hex()}")
    found = b""
    for number in range(-(-len(wanted) // 7)):
        (answer,) = client.asks(f"{0x60 | number % 2 << 4:02x}")
        rest = wanted[7 * number :]
        head = number % 2 << 4 | max(0, 7 - len(rest)) << 1 | (len(rest) <= 7)
        equal(answer[0], head, f"head of segment {number}")
        found += answer[1:][: len(rest)]
    equal(found, wanted, "the table")
    client.is_refused("60", _COMMAND)
    client.hears(f"40 {_TABLE}", f"41 {_TABLE} {len(wanted).to_bytes(4, 'little').hex()}")
    client.is_refused("70", _TOGGLE)


def a_table_is_fetched_by_blocks() -> None:
    """A block has as many segments as the client wants; lost segments are sent again; a checksum follows at the end."""
    client = Client()
    wanted = client.pe.table.to_json().encode()
    size = len(wanted).to_bytes(4, "little").hex()
    client.hears(f"a4 {_TABLE} 03", f"c6 {_TABLE} {size}")
    began_ns = client.says("a3")
    client.pe.run(30)
    first = client.answers(began_ns)
    equal([data[0] for data in first], [1, 2, 3], "numbers of the first block")
    equal(b"".join(data[1:] for data in first), wanted[:21], "the first block")
    apart = gaps(moments(client.pe.main.since(began_ns, [sdo_response_id(NODE)])))
    demand(all(0.25 * MS < gap < 0.5 * MS for gap in apart), f"segments are {apart} ns apart")  # half of the bus
    second = client.asks("a2 01 02", 30)  # two of three were lost
    equal([data[0] for data in second], [1, 2], "numbers of the second block")
    equal(b"".join(data[1:] for data in second), wanted[7:21], "the second block")
    client.is_refused("a2 03 02", _SEQUENCE)
    client.hears(f"a0 {_TABLE} 02", f"c2 {_TABLE} {size}")
    client.asks("a3", 30)
    client.is_refused("a2 02 00", _BLOCK_SIZE)
    client.hears(f"a0 {_TABLE} 02", f"c2 {_TABLE} {size}")
    client.is_refused("a2 00 02", _COMMAND)


def a_block_that_has_a_gap_is_told_so() -> None:
    """At its end, or after a pause, the client gets the number of segments in order; checksum and length must agree."""
    client = Client()
    client.hears(f"c6 {_TABLE} 0e", f"a4 {_TABLE} 20")
    equal(client.asks("01 31 32 33 34 35 36 37", 140), [], "answers before the end of a block")
    began_ns = client.pe.run(20)
    equal([data[:3].hex(" ") for data in client.answers(began_ns)], ["a2 01 20"], "answers when nothing more comes")
    client.hears("82 41 42 43 44 45 46 47", "a2 00 20")  # its number should have been 1
    client.hears("81 41 42 43 44 45 46 47", "a2 01 20")
    client.is_refused("c1 12 34", _CRC)
    client.hears(f"c2 {_TABLE} 0e", f"a0 {_TABLE} 20")
    client.hears("81 31 32 33 34 35 36 37", "a2 01 20")
    client.is_refused("c1", _LENGTH)


def a_table_of_any_length_is_fetched_by_blocks() -> None:
    """The last message has the number of unused bytes in the last segment, and the checksum of the other bytes."""
    for more in range(8):
        client = Client(PeUnderTest(replace(TABLE, spec=TABLE.spec + "x" * more)))
        wanted = client.pe.table.to_json().encode()
        client.hears(f"a4 {_TABLE} 7f", f"c6 {_TABLE} {len(wanted).to_bytes(4, 'little').hex()}")
        found, is_last, answers = b"", False, client.asks("a3", 100)
        while answers and not is_last:
            is_last = answers[-1][0] & 0x80 != 0
            numbers = [data[0] & 0x7F for data in answers]
            equal(numbers, list(range(1, len(answers) + 1)), "numbers of a block")
            found += b"".join(data[1:] for data in answers)
            answers = client.asks(f"a2 {len(answers):02x} 7f", 100)
        (end,) = answers
        unused = -len(wanted) % 7
        equal(found[: len(found) - unused], wanted, "the table")
        equal(
            end[:3].hex(" "), bytes((0xC1 | unused << 2, *crc_hqx(wanted, 0).to_bytes(2, "little"))).hex(" "), "its end"
        )
        equal(client.asks("a1"), [], "answers to the end")


def what_grows_too_long_is_refused_on_the_way() -> None:
    """Segments are refused at the first byte too many, a block at the first segment without a byte of the object."""
    client = Client()
    client.hears(f"21 {_TABLE} 07", f"60 {_TABLE}")
    client.hears("00 31 32 33 34 35 36 37", "20")  # all of it, and an empty segment may follow
    client.is_refused("10 31", _LENGTH)
    for begin, answer in ((f"c2 {_HEARTBEAT} 02", f"a0 {_HEARTBEAT} 20"), (f"c0 {_HEARTBEAT}", f"a0 {_HEARTBEAT} 20")):
        client.hears(begin, answer)
        equal(client.asks("01 f4 01"), [], "answers to the first segment")
        client.is_refused("02 f4 01", _LENGTH)
    client.hears(f"c2 {_TABLE} 07", f"a0 {_TABLE} 20")
    for segment in ("01", "02"):
        equal(client.asks(segment), [], f"answers to segment {segment}")
    client.is_refused("03", _LENGTH)


def nmt_ends_what_was_under_way() -> None:
    """A reset ends the transfer, where no manager is heard; so does stopping the node, which then does not answer."""
    client = Client()
    for reset in (129, 130):
        client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
        client.commands(reset)
        client.is_refused("0b f4 01", _COMMAND)
    client.hears(f"21 {_HEARTBEAT} 02", f"60 {_HEARTBEAT}")
    client.commands(2)
    equal(client.asks("0b f4 01"), [], "answers of a node that was stopped")
    client.commands(1)
    client.is_refused("0b f4 01", _COMMAND)
    client.hears(f"2b {_HEARTBEAT} f4 01", f"60 {_HEARTBEAT}")
