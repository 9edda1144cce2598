"""The management protocol: bytes written by hand, every message encoded and decoded, and any bytes decoded."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from heronry_wire.frame import Malformed
from heronry_wire.identifiers import PE_NODES, Command
from heronry_wire.management import (
    MAX_TERM,
    NO_EPOCH,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_command,
    decode_emergency,
    is_newer,
    next_epoch,
)
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
)

COMMAND_OF = {
    Lease: Command.LEASE,
    Alive: Command.ALIVE,
    Prepare: Command.PREPARE,
    SliceHead: Command.SLICE,
    SliceBody: Command.SLICE,
    Activate: Command.ACTIVATE,
    Ping: Command.PING,
    Control: Command.CONTROL,
}

bytes_1, bytes_2, bytes_3 = st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFF)
terms, epochs = st.integers(1, MAX_TERM), st.integers(0, 0xFFFF)
flags = st.integers(0, 7).map(PeFlags)
states = st.sampled_from(PeState)
messages = st.one_of(
    st.builds(Lease, terms, epochs, st.sampled_from(Step), bytes_3),
    st.builds(Alive, terms, bytes_1, st.frozensets(st.sampled_from(PE_NODES))),
    st.builds(Prepare, terms, epochs, bytes_3, st.integers(0, 0xFFF)),
    st.builds(SliceHead, bytes_1, bytes_1, bytes_2, bytes_3),
    st.builds(SliceBody, bytes_1, bytes_1, st.integers(1, 255), st.binary(min_size=5, max_size=5)),
    st.builds(Activate, terms, epochs, st.sampled_from(Step), bytes_3),
    st.builds(Ping, terms, bytes_1, bytes_1),
    st.builds(Control, terms, bytes_1, st.sampled_from(Operation), bytes_2, bytes_2),
)
pages = st.one_of(
    st.builds(StatePage0, states, flags, bytes_1, epochs, bytes_1, bytes_3),
    st.builds(StatePage1, states, flags, epochs, bytes_3, st.sampled_from(Reason), bytes_1),
    st.builds(StatePage2, states, flags, st.integers(0, (1 << 56) - 1)),
    st.builds(StatePage3, states, flags, bytes_3, bytes_2, bytes_2),
)
faults = st.builds(
    Emergency, st.sampled_from(FaultCode), bytes_1, st.sampled_from(ElementKind), index=bytes_2, detail=bytes_2
)
payloads = st.binary(max_size=9) | st.binary(min_size=8, max_size=8)

# Every message once, its fields apart as they travel.
GOLDEN: list[tuple[ManagementMessage, str]] = [
    (Lease(term=3, epoch=7, step=Step.GO, digest=0xABCDEF), "0003 0007 02 ABCDEF"),
    (Alive(term=3, sequence=9, nodes=frozenset({92, 94, 125})), "0003 09 02 00000005"),  # 6 spare bits, 125 .. 92
    (Prepare(term=3, epoch=7, digest=0xABCDEF, contingency=9), "003 009 0007 ABCDEF"),
    (SliceHead(node=93, epoch_low=7, length=40, digest=5), "5D 07 00 0028 000005"),
    (SliceBody(node=93, epoch_low=7, index=255, body=b"\x01\x02\x03\x04\x05"), "5D 07 FF 0102030405"),
    (Activate(term=4095, epoch=0xFFFF, step=Step.BREAK, digest=1), "0FFF FFFF 01 000001"),
    (Ping(term=1, node=93, sequence=4), "0001 5D 04"),
    (Control(term=1, node=93, operation=Operation.ACKNOWLEDGE, a=2, b=5), "0001 5D 01 0002 0005"),
]


@pytest.mark.parametrize(("message", "text"), GOLDEN, ids=lambda value: type(value).__name__)
def test_commands_byte_for_byte(message: ManagementMessage, text: str) -> None:
    data = bytes.fromhex(text.replace(" ", ""))
    assert message.encode() == data
    assert decode_command(COMMAND_OF[type(message)], data) == message


@pytest.mark.parametrize(
    ("page", "text"),
    [
        # 00 page 0, 011 ACTIVE, 101 OUTPUT_HELD and HEARS_LEASE
        (
            StatePage0(PeState.ACTIVE, PeFlags.OUTPUT_HELD | PeFlags.HEARS_LEASE, 4, 5, 6, 7),
            "1D 04 0005 06 000007",
        ),
        # 01 page 1, 001 BROKEN, 010 FAULT_PENDING
        (StatePage1(PeState.BROKEN, PeFlags.FAULT_PENDING, 8, 9, Reason.IMAGE, 50), "4A 0008 000009 04 32"),
        (StatePage2(PeState.BROKEN, PeFlags.FAULT_PENDING, 0x123456789ABCDE), "8A 123456789ABCDE"),
        (StatePage3(PeState.BROKEN, PeFlags.FAULT_PENDING, 0x10203, 0x405, 0x607), "CA 010203 0405 0607"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_states_byte_for_byte(page: StatePage, text: str) -> None:
    data = bytes.fromhex(text)
    assert page.encode() == data
    assert decode_state(data) == page


def test_an_emergency_byte_for_byte_with_its_code_little_endian() -> None:
    fault = Emergency(FaultCode.REPORTED, error_register=0x81, kind=ElementKind.DEVICE, index=3, detail=44)
    data = bytes.fromhex("03FF 81 01 0003 002C")
    assert fault.encode() == data
    assert decode_emergency(data) == fault


@given(messages)
def test_every_command_survives_the_bus(message: ManagementMessage) -> None:
    data = message.encode()
    assert len(data) <= 8
    assert decode_command(COMMAND_OF[type(message)], data) == message


@given(pages)
def test_every_state_survives_the_bus(page: StatePage) -> None:
    assert len(page.encode()) == 8
    assert decode_state(page.encode()) == page


@given(faults)
def test_every_emergency_survives_the_bus(fault: Emergency) -> None:
    assert decode_emergency(fault.encode()) == fault


def test_a_short_end_of_a_slice_is_filled_up_with_zeros() -> None:
    assert SliceBody(93, 7, 2, b"\x01\x02").encode() == SliceBody(93, 7, 2, b"\x01\x02\0\0\0").encode()


def test_a_load_beyond_the_byte_is_told_as_the_largest() -> None:
    page = StatePage1(PeState.ACTIVE, PeFlags(0), 1, 2, Reason.NONE, 400)
    assert decode_state(page.encode()) == StatePage1(PeState.ACTIVE, PeFlags(0), 1, 2, Reason.NONE, 255)


@pytest.mark.parametrize(
    "message",
    [
        Prepare(term=MAX_TERM + 1, epoch=1, digest=1),
        Lease(term=1, epoch=0x10000, step=Step.GO, digest=1),
        Lease(term=1, epoch=1, step=Step.GO, digest=-1),
        Alive(term=1, sequence=1, nodes=frozenset({91})),
        Alive(term=1, sequence=1, nodes=frozenset({126})),
        SliceBody(node=93, epoch_low=1, index=0, body=b"a head, read as one"),
        SliceBody(node=93, epoch_low=1, index=1, body=b"\0\0\0\0\0\1"),
        SliceBody(node=93, epoch_low=1, index=256, body=b""),
        StatePage1(PeState.ACTIVE, PeFlags(0), 1, 2, Reason.NONE, -1),
        Emergency(FaultCode.REPORTED, 1, ElementKind.MODULE, 3, 0x10000),
    ],
    ids=repr,
)
def test_what_does_not_fit_is_refused_and_never_cut(message: Lease | StatePage1 | Emergency) -> None:
    with pytest.raises(ValueError, match=r"\d|negative"):
        message.encode()


@given(st.integers(0, 12), payloads)
def test_any_bytes_of_any_command_are_a_message_or_malformed(command: int, data: bytes) -> None:
    message = decode_command(command, data)
    if isinstance(message, Malformed):
        assert message.reason
    elif isinstance(message, Alive):
        assert Alive(message.term, message.sequence, message.nodes).encode()[:3] == data[:3]  # but for its spare bits
    else:
        assert message.encode() == data


@given(payloads)
@example(bytes.fromhex("80 00000000000001"))
@example(bytes.fromhex("C0 00000000000001"))
@example(bytes.fromhex("20 00000000000000"))  # no state
@example(bytes.fromhex("40 0000000000 FF 00"))  # no reason
def test_any_bytes_are_a_state_or_malformed(data: bytes) -> None:
    page = decode_state(data)
    assert isinstance(page, Malformed) or page.encode() == data


@given(payloads)
@example(bytes.fromhex("03FF 00 FF 0000 0000"))  # no kind
@example(bytes.fromhex("1042 00 00 0000 0000"))  # a standard code, of another maker
def test_any_bytes_are_an_emergency_or_malformed(data: bytes) -> None:
    fault = decode_emergency(data)
    assert isinstance(fault, Malformed) or fault.encode() == data


@pytest.mark.parametrize(
    ("command", "text", "reason"),
    [
        (Command.TAG, "", "command 7 is not assigned"),
        (9, "", "command 9 is not assigned"),
        (Command.LEASE, "0003 0007 04 ABCDEF", "step"),
        (Command.ACTIVATE, "0003 0007 04 ABCDEF", "step"),
        (Command.LEASE, "0000 0007 02 ABCDEF", "term 0 is outside 1..4095"),
        (Command.LEASE, "FFFF 0007 02 ABCDEF", "term 65535 is outside 1..4095"),
        (Command.ALIVE, "1000 09 02 00000005", "term 4096"),
        (Command.PING, "1000 5D 04", "term 4096"),
    ],
)
def test_malformed_commands_say_what_is_wrong(command: int, text: str, reason: str) -> None:
    decoded = decode_command(command, bytes.fromhex(text))
    assert isinstance(decoded, Malformed)
    assert reason in decoded.reason


@pytest.mark.parametrize("command", [c for c in Command if c is not Command.TAG])
def test_a_command_cut_short_is_malformed(command: Command) -> None:
    decoded = decode_command(command, b"\0\1\2")
    assert isinstance(decoded, Malformed)
    assert decoded.reason.startswith(f"{command.name} has a wrong length")


# Epochs


@given(epochs)
def test_the_next_epoch_is_newer_also_around_the_end_and_never_none(epoch: int) -> None:
    following = next_epoch(epoch)
    assert 0 < following <= 0xFFFF
    assert is_newer(following, epoch)
    assert not is_newer(epoch, following)


@example(0, 0xFFFF)
@example(1, 0xFFFF)
@given(epochs, epochs)
def test_of_two_epochs_at_most_one_is_newer(one: int, other: int) -> None:
    assert not (is_newer(one, other) and is_newer(other, one))
    assert not is_newer(NO_EPOCH, one), "none is newer than nothing"
    assert is_newer(one, NO_EPOCH) == (one != NO_EPOCH)


@given(st.integers(1, 0xFFFF), st.integers(1, 30_000))
def test_half_a_turn_ahead_is_still_newer(epoch: int, steps: int) -> None:
    later = (epoch + steps - 1) % 0xFFFF + 1  # `steps` times next_epoch
    assert is_newer(later, epoch)
    assert not is_newer(epoch, later)


def test_an_operation_of_a_later_minor_keeps_its_number_and_what_is_no_byte_is_none() -> None:
    later = Operation(200)
    assert (later, later.name, later.is_known) == (200, "OPERATION_200", False)
    for value in (-1, 256, "HOLDS"):
        with pytest.raises(ValueError, match="is not a valid Operation"):
            Operation(value)
