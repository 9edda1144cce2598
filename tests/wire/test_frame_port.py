"""Frames around python-can: the raw socket of SocketCAN, played by a pair of sockets, and which port a bus gets."""

import socket
import time
from collections.abc import Iterator
from struct import pack
from typing import Any, cast

import can
import pytest

from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival, Haste, MessagePort, SocketCanPort, port_of
from heronry_wire.thinning import Thinned

STATE = 257


def record(can_id: int, data: bytes, length: int | None = None) -> bytes:
    """Return a struct can_frame of linux/can.h."""
    return pack("=IB3x8s", can_id, len(data) if length is None else length, data)


@pytest.fixture
def ends() -> Iterator[tuple[SocketCanPort, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with ours, theirs:
        yield SocketCanPort(ours), theirs


def frames(port: SocketCanPort, most: int = 64) -> list[Frame]:
    arrivals, _ = port.read(time.monotonic_ns(), most)
    return [arrival.frame for arrival in arrivals]


def test_every_kind_of_frame_is_read_as_it_was_sent(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, bus = ends
    for one in (
        record(0x123, b"abc"),
        record(0x9ABCDEF0 & 0x1FFFFFFF | 0x80000000, bytes(8)),
        record(0x40000123, b"", 4),
        record(0xC0000123, b""),
        record(0x20000040, bytes(8)),
    ):
        bus.send(one)
    assert frames(port) == [
        Frame(0x123, b"abc"),
        Frame(0x1ABCDEF0, bytes(8), extended=True),
        Frame(0x123, b"", remote=True),
        Frame(0x123, b"", extended=True, remote=True),
        Frame(0x40, bytes(8), error=True),
    ]


def test_a_flood_is_read_in_parts(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, bus = ends
    for number in range(3):
        bus.send(record(number, b""))
    now_ns = time.monotonic_ns()
    assert port.read(now_ns, 2) == ([Arrival(now_ns, Frame(0, b"")), Arrival(now_ns, Frame(1, b""))], True)
    assert port.read(now_ns, 2) == ([Arrival(now_ns, Frame(2, b""))], False)


def test_states_that_say_nothing_new_are_dropped(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, bus = ends
    port.thin(Thinned(frozenset((STATE,)), frozenset(), 0xFF00_0000_0000_0000, 1_000_000_000))
    for can_id, data in (
        (STATE, b"\1\1"),
        (STATE, b"\1\2"),
        (300, b"\1\1"),
        (STATE, b"\2\1"),
        (STATE | 0x8000_0000, b""),
    ):
        bus.send(record(can_id, data))
    assert frames(port) == [
        Frame(STATE, b"\1\1"),
        Frame(300, b"\1\1"),
        Frame(STATE, b"\2\1"),
        Frame(STATE, b"", extended=True),
    ]


@pytest.mark.parametrize("frame", [Frame(0x123, b"ab"), Frame(0x1ABCDEF0, bytes(8), extended=True)])
def test_a_frame_is_sent_as_linux_wants_it(ends: tuple[SocketCanPort, socket.socket], frame: Frame) -> None:
    port, bus = ends
    port.send(frame, Haste.URGENT)
    flag = 0x8000_0000 if frame.extended else 0
    assert bus.recv(100) == record(frame.can_id | flag, frame.data)


def test_a_bus_without_a_port_of_its_own_is_used_by_messages() -> None:
    with can.Bus(interface="virtual", channel="test_frame_port") as bus:
        made = port_of(bus, has_nothing_left=lambda: True, noise=lambda: None)
    assert isinstance(made, MessagePort)
    assert (made.gathers, made.mailboxes) == (False, 1)


def test_a_bus_that_only_calls_itself_socketcan_is_used_by_messages() -> None:
    class Pretender:
        channel_info = "socketcan can0"
        socket = None

    made = port_of(cast("Any", Pretender()), has_nothing_left=lambda: True, noise=lambda: None)
    assert isinstance(made, MessagePort)
