"""Readers of single fields agree with the decoders."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.canaerospace import DataType, Datum, encode_data, node_of, read_header, type_and_service_of
from heronry_wire.identifiers import PE_NODES, Command
from heronry_wire.layout import Field, Layout
from heronry_wire.management import (
    Alive,
    Control,
    Operation,
    SliceBody,
    control_node,
    decode_command,
    decode_tag,
    read_alive,
    slice_node,
    tag_kind,
    without_sequence,
)
from heronry_wire.nmt import NmtCommand, NmtState, code_of, decode_heartbeat, encode_heartbeat
from heronry_wire.nmt import decode_command as decode_nmt
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage0,
    StatePage1,
    epoch_of,
    page_of,
    sequence_of,
)
from heronry_wire.state_frames import without_sequence as state_without_sequence

PAGE_0 = StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 7, 0x1234, 200, 0xABCDEF)


def test_readers_of_a_state() -> None:
    data = PAGE_0.encode()
    assert (page_of(data), epoch_of(data), sequence_of(data)) == (0, 0x1234, 200)
    later = StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 7, 0x1234, 201, 0xABCDEF).encode()
    assert state_without_sequence(data) == state_without_sequence(later) != data
    assert page_of(StatePage1(PeState.ACTIVE, PeFlags(0), 1, 2, Reason.NONE, 3).encode()) == 1
    assert page_of(b"") is None


@given(st.frozensets(st.sampled_from(PE_NODES)), st.sampled_from(PE_NODES))
def test_readers_of_an_alive(nodes: frozenset[int], node: int) -> None:
    one, other = (Alive(5, sequence, nodes).encode() for sequence in (1, 2))
    assert read_alive(one, node) == (5, node in nodes)
    assert without_sequence(one) == without_sequence(other)
    assert decode_command(Command.ALIVE, one) == Alive(5, 1, nodes)


def test_readers_of_other_commands() -> None:
    assert read_alive(b"\0", 92) is None
    assert control_node(Control(1, 94, Operation.RENEW).encode()) == 94
    assert slice_node(SliceBody(93, 1, 2, b"abc").encode()) == 93
    assert decode_tag(bytes((0b0110_0001, 2, 0, 0, 0, 0, 0, 9))) == (3, 0x102, 9)
    assert decode_tag(b"") is None
    assert (tag_kind(b"\x61"), tag_kind(b"")) == (3, None)


def test_readers_of_a_datum() -> None:
    data = encode_data(300, Datum(92, DataType.UCHAR, 0x11, 7, 5)).data
    assert read_header(data) == (92, DataType.UCHAR, 0x11, 7)
    assert (node_of(data), node_of(b"")) == (92, None)
    assert type_and_service_of(data) == bytes((DataType.UCHAR, 0x11))


def test_readers_of_network_management() -> None:
    assert decode_nmt(b"\x01\x5c") == NmtCommand(1, 92)
    assert decode_nmt(b"\x01") is None
    assert code_of(b"\x81\0") == 129
    assert decode_heartbeat(encode_heartbeat(NmtState.OPERATIONAL)) == 5


def test_only_a_field_of_whole_bytes_has_a_span() -> None:
    layout = Layout("X", Field("a", 4), Field("b", 4), Field("c", 8))
    assert layout.span("c") == (1, 2)
    for name in ("a", "b", "d"):
        with pytest.raises(ValueError, match=f"X has no field '{name}' that consists of whole bytes"):
            layout.span(name)
