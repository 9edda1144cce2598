"""The port of a node on a software bus: many frames in a packet, mailboxes by priority, echoes that may wait."""

import select
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from heronry_tools.runtime.softbus.batches import Batches
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.protocol import MAILBOXES, RECORD_BYTES, Fate, encode_received, frames_of
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Haste
from heronry_wire.python_can import is_full
from heronry_wire.thinning import Thinned

PATIENCE_S = 20.0


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[HubProcess]:
    """A slow bus: a frame of eight bytes takes about 50 ms."""
    with start_hub(tmp_path / "bus", bitrate=2_000) as process:
        yield process


class Node:
    """A client with a port, and all that it has received."""

    def __init__(self, hub: HubProcess) -> None:
        self.bus = SoftBus(str(hub.path))
        self.port: Batches = self.bus.frame_port()
        self.frames: list[Frame] = []

    def send(self, haste: Haste, *frames: Frame) -> None:
        for frame in frames:
            self.port.send(frame, haste)
        self.port.flush()

    def until(self, holds: Callable[[], bool]) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end_s, self.frames
            select.select([self.bus], [], [], 0.05)
            arrivals, _ = self.port.read(time.monotonic_ns(), 64)
            self.frames += [arrival.frame for arrival in arrivals]

    def ids(self) -> list[int]:
        return [frame.can_id for frame in self.frames]


@pytest.fixture
def nodes(hub: HubProcess) -> Iterator[tuple[Node, Node]]:
    sender, receiver = Node(hub), Node(hub)
    with sender.bus, receiver.bus:
        yield sender, receiver


@pytest.mark.parametrize("haste", Haste)
def test_mailboxes_compete_by_priority_and_every_frame_is_echoed(nodes: tuple[Node, Node], haste: Haste) -> None:
    sender, receiver = nodes
    receiver.send(Haste.URGENT, Frame(10, bytes(8)))  # the bus is busy for a while
    sender.send(haste, *(Frame(can_id, bytes(8)) for can_id in (700, 500, 600, 400)))
    receiver.until(lambda: len(receiver.frames) == 5)
    assert receiver.ids() == [10, 400, 500, 600, 700]
    sender.until(lambda: len(sender.frames) == 5)
    assert sender.ids() == receiver.ids()


def test_frames_of_one_identifier_stay_in_their_order(nodes: tuple[Node, Node]) -> None:
    sender, receiver = nodes
    sender.send(Haste.PATIENT, *(Frame(300, bytes([number])) for number in range(MAILBOXES)))
    receiver.until(lambda: len(receiver.frames) == MAILBOXES)
    assert [frame.data[0] for frame in receiver.frames] == list(range(MAILBOXES))


def test_a_frame_too_many_is_refused_until_one_has_left(nodes: tuple[Node, Node]) -> None:
    sender, _ = nodes
    sender.send(Haste.PATIENT, *(Frame(can_id, bytes(8)) for can_id in range(MAILBOXES)))
    with pytest.raises(can.CanOperationError) as refused:
        sender.port.send(Frame(99, b""), Haste.PATIENT)
    assert is_full(refused.value)
    sender.port.want_echo()
    sender.until(lambda: len(sender.frames) >= 1)
    sender.send(Haste.PATIENT, Frame(99, b""))
    sender.until(lambda: len(sender.frames) == MAILBOXES + 1)


def test_what_is_withdrawn_is_never_sent_and_frees_its_mailbox(nodes: tuple[Node, Node]) -> None:
    sender, receiver = nodes
    doomed = frozenset(range(200, 200 + MAILBOXES - 1))
    sender.send(Haste.PATIENT, *(Frame(can_id, bytes(8)) for can_id in (100, *doomed)))
    sender.port.withdraw(doomed)
    sender.until(lambda: sender.port._offered == 0)
    sender.send(Haste.URGENT, *(Frame(can_id, b"") for can_id in range(300, 300 + MAILBOXES)))
    receiver.until(lambda: 300 + MAILBOXES - 1 in receiver.ids())
    assert receiver.ids() == [100, *range(300, 300 + MAILBOXES)]
    assert sender.ids() == [100], "what was withdrawn is no echo"


def test_a_patient_echo_waits_for_the_next_frame_and_a_wanted_one_does_not(nodes: tuple[Node, Node]) -> None:
    sender, receiver = nodes
    sender.send(Haste.PATIENT, Frame(1, b""))
    receiver.send(Haste.PATIENT, Frame(2, b""))
    sender.until(lambda: sender.ids() == [1, 2])
    sender.send(Haste.PATIENT, Frame(3, b""))
    sender.port.want_echo()
    sender.until(lambda: sender.ids() == [1, 2, 3])


def test_the_hub_thins_a_group_for_the_client_that_wants_it(nodes: tuple[Node, Node]) -> None:
    sender, receiver = nodes
    receiver.port.thin(Thinned(frozenset((257,)), frozenset((200,)), 0xFF << 56, 3_600_000_000_000))
    sender.send(Haste.URGENT, *(Frame(257, data) for data in (b"\1a", b"\1b", b"\2a", b"\1c")), Frame(300, b""))
    receiver.until(lambda: 300 in receiver.ids())
    assert [frame.data for frame in receiver.frames] == [b"\1a", b"\2a", b""]


def test_a_client_that_leaves_lets_its_frames_go_first(hub: HubProcess) -> None:
    receiver = Node(hub)
    with receiver.bus:
        leaving = Node(hub)
        leaving.send(Haste.PATIENT, *(Frame(can_id, bytes(8)) for can_id in (1, 2, 3)))
        leaving.bus.shutdown()
        receiver.until(lambda: receiver.ids() == [1, 2, 3])


def test_the_end_of_the_hub_is_an_error(hub: HubProcess) -> None:
    node = Node(hub)
    hub.kill()
    with pytest.raises(can.CanOperationError, match="the bus is gone"):
        node.until(lambda: False)
    with pytest.raises(can.CanOperationError, match="the bus is gone"):
        node.send(Haste.URGENT, Frame(1, b""))
    node.bus.shutdown()


def test_packets_come_back_as_they_were() -> None:
    plain, extended = Frame(0x123, b"ab"), Frame(0x1ABCDEF0, b"", extended=True, remote=True)
    packet = encode_received(plain, 2, 5) + encode_received(extended, 8, 6, Fate.SENT)
    packet += encode_received(plain, 2, 7, Fate.WITHDRAWN)
    assert list(frames_of(packet)) == [(5, None, plain), (6, Fate.SENT, extended), (7, Fate.WITHDRAWN, plain)]
    for wrong in (packet[:-1], b"{" * RECORD_BYTES):
        with pytest.raises(ValueError, match=r"a packet of frames|is unknown"):
            list(frames_of(wrong))
