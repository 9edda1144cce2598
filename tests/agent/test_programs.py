"""Code over the bus as an unmodified CANopen master sees it (CiA 302-3), and the extension that goes on."""

from hashlib import sha256

import pytest
from canopen import SdoAbortedError

from agent.canopen_master import Master, refusal
from agent.one_pe import FLYING, MS, NODE, TABLE, OnePe
from heronry_agent.core.agent import AgentCore
from heronry_agent.core.canopen.programs import KEEP_NS
from heronry_agent.core.vocabulary import (
    Action,
    ControlProgram,
    ImagesArrived,
    ImagesMissing,
    KeepParts,
    ProgramChanged,
    ProgramState,
    WriteProgram,
)
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.part_transfer import Part, Received, Transfer
from heronry_wire.sansio import InvariantError, Send
from heronry_wire.sdo import BLOCK_ACKNOWLEDGE, BLOCK_DOWNLOAD, BLOCK_SIZE_GIVEN, LATE_NS, UPLOAD, segment, with_number
from heronry_wire.timing import worst_bits

CONTENT = bytes(range(256)) * 8
TRANSFER = Transfer(sha256(CONTENT).digest(), len(CONTENT))
NO_CODE = ProgramState()
BUSY, PART_WRONG, CRC, TOO_LARGE, LENGTH = 0x0800_0022, 0x0609_0030, 0x0504_0004, 0x0504_0005, 0x0607_0010


class WithLoader(OnePe):
    """A PE with a loader, whose orders are kept for the test."""

    def __init__(self, state: ProgramState, kept: bytes = b"") -> None:
        self.orders: list[Action] = []
        super().__init__()
        self.core = AgentCore(TABLE, 5, self.now_ns, program=state, kept_parts=kept)

    def give(self, event):
        actions = super().give(event)
        self.orders += [one for one in actions if isinstance(one, WriteProgram | KeepParts | ControlProgram)]
        return actions


class Programmer(Master):
    """The master, with the objects of a program."""

    def __init__(self, state: ProgramState = NO_CODE, kept: bytes = b"") -> None:
        pe = WithLoader(state, kept)
        super().__init__(pe)
        self.loader = pe
        pe.pass_time(0)
        self.data, self.control = self.sdo[0x1F50][1], self.sdo[0x1F51][1]

    @property
    def version(self) -> int:
        return int(self.sdo[0x1F56][1].raw)

    @property
    def active(self) -> bytes:
        return bytes(self.sdo.upload(0x2030, 3))

    @property
    def status(self) -> int:
        return int(self.sdo[0x1F57][1].raw)

    @property
    def received(self) -> Received:
        found = Received.decode(self.sdo.upload(0x2030, 2))
        assert found is not None
        return found

    def download(self, content: bytes) -> None:
        with self.data.open("wb", size=len(content), block_transfer=True, buffering=7) as stream:
            stream.write(content)

    def part(self, at: int, data: bytes, transfer: Transfer = TRANSFER) -> int | None:
        content = Part(transfer, at, data).encode()
        try:
            self.sdo.download(0x2030, 1, content)
        except SdoAbortedError as error:
            return int(error.code)
        return None

    def answer(self, version: int, error: int = 0) -> None:
        self.loader.give(ProgramChanged(ProgramState(version, error)))

    def orders(self) -> list[Action]:
        """The orders to the loader since the last call, without those to keep parts."""
        said, self.loader.orders = self.loader.orders, []
        return [one for one in said if not isinstance(one, KeepParts)]

    def kept(self) -> list[bytes]:
        """What the loader was told to keep."""
        return [one.content for one in self.loader.orders if isinstance(one, KeepParts)]


@pytest.fixture
def master() -> Programmer:
    return Programmer()


def test_a_master_stops_clears_writes_looks_and_starts_by_the_book(master: Programmer) -> None:
    assert (master.control.raw, master.version, master.status) == (0, 0, 0)
    master.control.raw = 0
    assert master.orders() == []
    master.control.raw = 3
    assert master.status == 1
    master.answer(0)
    assert master.orders() == [ControlProgram(is_start=False)]
    master.download(CONTENT)
    assert master.orders() == [WriteProgram(CONTENT)]
    assert master.status == 1
    master.answer(0)
    assert (master.status, master.control.raw) == (0, 0)
    master.control.raw = 1
    assert master.orders() == [ControlProgram(is_start=True)]
    master.answer(7)
    assert (master.status, master.version, master.control.raw) == (0, 7, 1)


def test_which_bundle_runs_is_read(master: Programmer) -> None:
    assert master.active == b""
    master.loader.give(ProgramChanged(ProgramState(7, digest=TRANSFER.digest)))
    assert (master.version, master.active) == (7, TRANSFER.digest)


def test_while_the_loader_is_at_work_nothing_is_taken(master: Programmer) -> None:
    master.download(CONTENT)
    assert refusal(lambda: master.download(CONTENT)) == BUSY
    assert refusal(lambda: setattr(master.control, "raw", 1)) == BUSY
    assert master.part(0, CONTENT) == BUSY
    assert len(master.orders()) == 1


def test_two_writes_that_began_before_the_loader_was_at_work_end_as_one(master: Programmer) -> None:
    programs = master.loader.core._programs
    assert programs.write(CONTENT) is None
    assert programs.write(CONTENT).value == BUSY
    assert programs.write_part(Part(TRANSFER, 0, CONTENT).encode()).value == BUSY


def test_the_last_error_of_the_loader_is_read_by_the_book(master: Programmer) -> None:
    master.download(CONTENT)
    master.answer(0, error=3)
    assert master.status == 3 << 1


@pytest.mark.parametrize("value", [2, 4, 255])
def test_another_order_than_stop_start_and_clear_is_refused(master: Programmer, value: int) -> None:
    assert refusal(lambda: setattr(master.control, "raw", value)) == PART_WRONG
    assert master.orders() == []


def test_a_program_that_is_stopped_says_so_and_nothing_else_follows() -> None:
    master = Programmer(ProgramState(4))
    assert master.control.raw == 1
    master.control.raw = 0
    assert (master.control.raw, master.version, master.orders()) == (0, 4, [])


def test_a_transfer_in_parts_goes_on_where_it_was_cut_off(master: Programmer) -> None:
    assert master.part(0, CONTENT[:700]) is None
    assert master.received == Received(TRANSFER.digest, 700)
    assert master.part(0, CONTENT[:700]) == PART_WRONG  # a doubled part changes nothing
    assert master.part(700, CONTENT[700:1400]) is None
    assert master.part(700, CONTENT[700:1400]) == PART_WRONG
    assert master.part(0, CONTENT[:700]) == PART_WRONG  # nor does a late first one
    assert master.part(1401, CONTENT[1401:]) == PART_WRONG
    assert master.received == Received(TRANSFER.digest, 1400)
    assert master.orders() == []
    assert master.part(1400, CONTENT[1400:]) is None
    assert master.orders() == [WriteProgram(CONTENT)]
    assert master.received.length == 0


def test_parts_of_another_bundle_begin_anew_and_are_never_mixed(master: Programmer) -> None:
    other = Transfer(bytes(32), len(CONTENT))
    master.part(0, CONTENT[:700])
    assert master.part(700, CONTENT[700:], other) == PART_WRONG
    assert master.received == Received(other.digest, 0)
    assert master.part(0, CONTENT, other) == CRC
    assert master.part(0, CONTENT + b"?") == PART_WRONG
    assert master.part(0, CONTENT, Transfer(bytes(32), 1 << 21)) == TOO_LARGE
    assert refusal(lambda: master.sdo.download(0x2030, 1, bytes(40))) == LENGTH
    assert master.orders() == []


def test_clear_and_a_whole_write_forget_the_parts(master: Programmer) -> None:
    master.part(0, CONTENT[:700])
    master.control.raw = 3
    master.answer(0)
    assert master.received.length == 0
    master.part(0, CONTENT[:700])
    master.download(CONTENT)
    assert master.received.length == 0


def test_a_pe_without_a_loader_is_told_nothing_by_one() -> None:
    pe = OnePe()
    with pytest.raises(InvariantError, match="started without one"):
        pe.give(ProgramChanged(ProgramState()))


def test_code_that_arrives_is_missing_no_more() -> None:
    pe = OnePe()
    image = TABLE.modules[0].image
    pe.give(ImagesMissing({image: "there is no such module"}))
    assert image in pe.core.staging.reader.missing_images
    pe.give(ImagesArrived(frozenset((image, "never:Missing"))))
    assert pe.core.staging.reader.missing_images == {}
    pe.give(ImagesMissing({image: "it was taken back"}))  # and may be missing again, which is told again
    assert image in pe.core.staging.reader.missing_images


def test_what_has_come_is_kept_now_and_then_and_goes_on_after_a_restart(master: Programmer) -> None:
    master.part(0, CONTENT[:500])
    master.part(500, CONTENT[500:700])
    assert master.kept() == [Part(TRANSFER, 0, CONTENT[:500]).encode()]
    master.loader.pass_time(KEEP_NS)
    master.part(700, CONTENT[700:900])
    assert master.kept()[1:] == [Part(TRANSFER, 0, CONTENT[:900]).encode()]
    again = Programmer(kept=master.kept()[-1])
    assert again.received == Received(TRANSFER.digest, 900)
    assert again.part(900, CONTENT[900:]) is None
    assert again.orders() == [WriteProgram(CONTENT)]


@pytest.mark.parametrize(
    "kept",
    [
        b"",
        bytes(40),
        Part(TRANSFER, 7, CONTENT[:500]).encode(),
        Part(TRANSFER, 0, CONTENT).encode(),
        Part(Transfer(TRANSFER.digest, 2 << 20), 0, CONTENT).encode(),
    ],
)
def test_what_is_no_beginning_of_a_bundle_was_not_kept(kept: bytes) -> None:
    assert Programmer(kept=kept).received == Received(bytes(32), 0)


def test_what_was_kept_and_is_wrong_ends_with_the_check_sum_and_the_transfer_begins_anew() -> None:
    master = Programmer(kept=Part(TRANSFER, 0, b"x" * 500).encode())
    assert master.part(500, CONTENT[500:]) == CRC
    assert master.received == Received(TRANSFER.digest, 0)
    assert master.part(0, CONTENT) is None
    assert master.orders() == [WriteProgram(CONTENT)]


PACE_NS = 10 * worst_bits(8) * 1_000  # a tenth of 1 Mbit/s
REQUEST = sdo_request_id(NODE)


def in_flight() -> WithLoader:
    """A PE that flies, and to which a client has announced a bundle of 700 bytes."""
    pe = WithLoader(NO_CODE)
    pe.pass_time(0)
    pe.configure(FLYING, 7)
    pe.pass_time(100 * MS)
    pe.hear(Frame(REQUEST, with_number(BLOCK_DOWNLOAD | BLOCK_SIZE_GIVEN, 0x1F50, 1, 700)))
    pe.pass_time(10 * MS)
    return pe


def block_answers(pe: WithLoader, since_ns: int) -> list[tuple[int, int]]:
    """When a block was answered since then, in ns, and how many of its segments had come."""
    sends = [(t_ns, one) for t_ns, one in pe.done if t_ns >= since_ns and isinstance(one, Send)]
    found = [(t_ns, one.frame.data) for t_ns, one in sends if one.frame.can_id == sdo_response_id(NODE)]
    return [(t_ns - since_ns, data[1]) for t_ns, data in found if data[0] & 3 == BLOCK_ACKNOWLEDGE]


@pytest.mark.parametrize("at_once", [1, 2, 4, 7])
def test_in_flight_segments_at_a_tenth_of_the_bus_are_taken_however_late_their_client_wakes(at_once: int) -> None:
    pe = in_flight()
    began_ns = pe.now_ns
    for number in range(1, 33):
        due_ns = (number - 1) * PACE_NS
        wakes_ns = -(-due_ns // (at_once * PACE_NS)) * at_once * PACE_NS
        pe.pass_time(began_ns + wakes_ns - pe.now_ns)
        pe.hear(Frame(REQUEST, segment(number, bytes(7))))
    last_ns = pe.now_ns - began_ns
    pe.pass_time(10 * MS)
    assert block_answers(pe, began_ns) == [(last_ns, 32)]


def test_in_flight_a_block_that_came_at_once_is_answered_when_a_tenth_of_the_bus_allows_it() -> None:
    pe = in_flight()
    began_ns = pe.now_ns
    for number in range(1, 33):
        pe.hear(Frame(REQUEST, segment(number, bytes(7))))
    pe.hear(Frame(REQUEST, with_number(UPLOAD, 0x1F57, 1, 0)))  # a client that does not wait for its answer
    pe.pass_time(100 * MS)
    answered_ns, received = block_answers(pe, began_ns)[0]
    assert received == 32
    assert 31 * PACE_NS - LATE_NS <= answered_ns <= 31 * PACE_NS
