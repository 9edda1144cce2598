"""The contract of every bus of the product: tested on the software bus, and on SocketCAN where there is a vcan0.

The stories that need arbitration and bus time run on the software bus alone, since vcan has neither.
"""

import asyncio
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import can
import pytest

from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from heronry_wire.frame import Frame
from heronry_wire.timing import exact_bits

PATIENCE_S = 10.0  # when a wait is this long, something is broken; nothing is measured with it

PUPPET = """
import can, json, sys
with can.Bus(**json.loads(sys.argv[1]), ignore_config=True) as bus:
    print("joined", flush=True)
    for line in sys.stdin:
        bus.send(can.Message(arbitration_id=int(line), is_extended_id=False))
        print("offered", flush=True)
"""


class Medium:
    """A way to open buses that all hear each other; everything opened is closed at the end of the test."""

    def __init__(self, address: dict[str, str], undo: ExitStack) -> None:
        self.address = address
        self._undo = undo

    def open(self, **options: object) -> can.BusABC:
        return self._undo.enter_context(can.Bus(**self.address, **options, ignore_config=True))

    def puppet(self) -> "Puppet":
        return self._undo.enter_context(Puppet(self.address))


class Puppet:
    """A client in a process of its own, that can be stopped and killed."""

    def __init__(self, address: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", PUPPET, json.dumps(address)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.pid = self._process.pid
        self._expect("joined")

    def offer(self, can_id: int) -> None:
        self._process.stdin.write(f"{can_id}\n")
        self._process.stdin.flush()
        self._expect("offered")

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)
        if number == signal.SIGKILL:
            self._process.wait()

    def _expect(self, line: str) -> None:
        assert self._process.stdout.readline().strip() == line

    def __enter__(self) -> "Puppet":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.send_signal(signal.SIGCONT)
        self._process.communicate()


@pytest.fixture
def undo() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture(
    params=[
        "softbus",
        pytest.param(
            "vcan",
            marks=[
                pytest.mark.vcan,
                pytest.mark.skipif(not Path("/sys/class/net/vcan0").exists(), reason="there is no vcan0"),
            ],
        ),
    ]
)
def medium(request: pytest.FixtureRequest, tmp_path: Path, undo: ExitStack) -> Medium:
    if request.param == "vcan":
        return Medium({"interface": "socketcan", "channel": "vcan0"}, undo)
    undo.enter_context(start_hub(tmp_path / "bus"))
    return Medium({"interface": "softbus", "channel": str(tmp_path / "bus")}, undo)


@pytest.fixture
def hub_at(tmp_path: Path, undo: ExitStack) -> Callable[[int], tuple[HubProcess, Medium]]:
    def start(bitrate: int) -> tuple[HubProcess, Medium]:
        hub = undo.enter_context(start_hub(tmp_path / "bus", bitrate))
        return hub, Medium({"interface": "softbus", "channel": str(hub.path)}, undo)

    return start


def standard(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, is_extended_id=False, data=data)


def next_of(bus: can.BusABC) -> can.Message:
    message = bus.recv(PATIENCE_S)
    assert message is not None, "nothing was received"
    return message


def ids_until(bus: can.BusABC, last: int) -> list[int]:
    """Receive up to and including the identifier `last`: what is missing then did not come, or never will."""
    ids = [next_of(bus).arbitration_id]
    while ids[-1] != last:
        ids.append(next_of(bus).arbitration_id)
    return ids


def length_bits(message: can.Message) -> int:
    frame = Frame(message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame)
    return exact_bits(frame)


def talk_all_at_once(senders: list[can.BusABC], reader: can.BusABC, frames_each: int) -> list[can.Message]:
    """Let every sender send without pause, the next frame at the echo of the last; return what is read.

    The echo is recognized by its identifier: python-can's SocketCAN says `is_rx` False of whatever this host sent.
    """
    left = dict.fromkeys(senders, frames_each)
    own_id = {bus: 0x100 + number for number, bus in enumerate(senders)}
    heard: list[can.Message] = []

    def send_next(bus: can.BusABC) -> None:
        if left[bus]:
            left[bus] -= 1
            bus.send(standard(own_id[bus], left[bus].to_bytes(4, "big")), timeout=0)

    for bus in senders:
        send_next(bus)
    while len(heard) < frames_each * len(senders):
        readable, _, _ = select.select([reader, *senders], [], [], PATIENCE_S)
        assert readable, "the bus has fallen silent"
        for bus in readable:  # one frame each a turn: vcan takes no time, and would run ahead of the readers
            message = next_of(bus)
            if bus is reader:
                heard.append(message)
            elif message.arbitration_id == own_id[bus]:
                send_next(bus)
    return heard


FRAMES = [
    *(standard(0x7FF, bytes(range(length))) for length in range(9)),
    standard(0x000),
    can.Message(arbitration_id=0x1FFF_FFFF, data=bytes(8)),
    can.Message(arbitration_id=0x123, data=b"extended, with a small identifier"[:8]),
    can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=5),
    can.Message(arbitration_id=0x1234567, is_remote_frame=True, dlc=8),
]


@pytest.mark.parametrize("sent", FRAMES, ids=lambda m: f"{m.arbitration_id:x}-{'remote' * m.is_remote_frame}{m.dlc}")
def test_every_kind_of_frame_arrives_as_it_was_sent(medium: Medium, sent: can.Message) -> None:
    sender, receiver = medium.open(), medium.open()
    sender.send(sent)
    received = next_of(receiver)
    assert received.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_frames_of_one_sender_keep_their_order(medium: Medium) -> None:
    sender, receiver = medium.open(), medium.open()
    for number in range(100):
        sender.send(standard(0x700 - number, bytes([number])), timeout=PATIENCE_S)
    assert [next_of(receiver).data[0] for _ in range(100)] == list(range(100))


def test_a_sender_hears_itself_only_if_it_asks(medium: Medium) -> None:
    quiet, curious = medium.open(), medium.open(receive_own_messages=True)
    quiet.send(standard(1))
    curious.send(standard(2), timeout=PATIENCE_S)
    assert ids_until(quiet, 2) == [2]
    assert ids_until(curious, 2) == [1, 2]


def test_an_echo_is_marked_as_sent(medium: Medium) -> None:
    sender = medium.open(receive_own_messages=True)
    sender.send(standard(1))
    assert not next_of(sender).is_rx


def test_the_mailbox_is_empty_when_the_echo_has_come(medium: Medium) -> None:
    sender = medium.open(receive_own_messages=True)
    for number in range(50):
        sender.send(standard(number), timeout=0)
        assert next_of(sender).arbitration_id == number


def test_filters_let_pass_what_they_name(medium: Medium) -> None:
    sender = medium.open()
    picky = medium.open(
        can_filters=[
            {"can_id": 0x100, "can_mask": 0x7F0, "extended": False},
            {"can_id": 0x200, "can_mask": 0x1FFF_FFFF, "extended": True},
        ]
    )
    for can_id in (0x0FF, 0x100, 0x10F, 0x110, 0x200):
        sender.send(standard(can_id), timeout=PATIENCE_S)
    for can_id in (0x100, 0x200):
        sender.send(can.Message(arbitration_id=can_id), timeout=PATIENCE_S)
    heard = [next_of(picky) for _ in range(3)]
    assert [(message.arbitration_id, message.is_extended_id) for message in heard] == [
        (0x100, False),
        (0x10F, False),
        (0x200, True),
    ]


def test_filters_can_be_changed_and_taken_away(medium: Medium) -> None:
    sender, receiver = medium.open(), medium.open()
    receiver.set_filters([{"can_id": 2, "can_mask": 0x7FF}])
    for can_id in (1, 2):
        sender.send(standard(can_id), timeout=PATIENCE_S)
    assert ids_until(receiver, 2) == [2]
    receiver.set_filters(None)
    for can_id in (1, 2):
        sender.send(standard(can_id), timeout=PATIENCE_S)
    assert ids_until(receiver, 2) == [1, 2]


def test_filters_hold_back_echoes_too(medium: Medium) -> None:
    sender = medium.open(receive_own_messages=True, can_filters=[{"can_id": 2, "can_mask": 0x7FF}])
    for can_id in (1, 2):
        sender.send(standard(can_id), timeout=PATIENCE_S)
    assert ids_until(sender, 2) == [2]


def test_a_frame_goes_out_though_its_sender_leaves_at_once(medium: Medium) -> None:
    receiver = medium.open()
    with can.Bus(**medium.address, ignore_config=True) as brief:
        brief.send(standard(0x55))
    assert next_of(receiver).arbitration_id == 0x55


def test_a_notifier_receives_while_others_send(medium: Medium) -> None:
    left, right = medium.open(), medium.open()
    heard = can.BufferedReader()
    with can.Notifier([left, right], [heard], timeout=0.1):
        for number in range(50):
            left.send(standard(number), timeout=PATIENCE_S)
            right.send(standard(number), timeout=PATIENCE_S)
        ids = [heard.get_message(PATIENCE_S).arbitration_id for _ in range(100)]
    assert sorted(ids) == sorted([*range(50), *range(50)])


def test_an_event_loop_can_watch_the_bus(medium: Medium) -> None:
    sender, receiver = medium.open(), medium.open()

    async def receive_one() -> can.Message | None:
        loop = asyncio.get_running_loop()
        readable = loop.create_future()
        loop.add_reader(receiver.fileno(), lambda: readable.done() or readable.set_result(None))
        sender.send(standard(0x77))
        await asyncio.wait_for(readable, PATIENCE_S)
        loop.remove_reader(receiver.fileno())
        return receiver.recv(0)

    received = asyncio.run(receive_one())
    assert received is not None
    assert received.arbitration_id == 0x77


def test_a_reading_client_loses_nothing_at_full_load(medium: Medium) -> None:
    senders = [medium.open(receive_own_messages=True) for _ in range(4)]
    heard = talk_all_at_once(senders, medium.open(), frames_each=250)
    for number in range(4):
        mine = [int.from_bytes(m.data, "big") for m in heard if m.arbitration_id == 0x100 + number]
        assert mine == list(reversed(range(250)))


def test_a_dead_client_leaves_the_others_alone(medium: Medium) -> None:
    left, right = medium.open(), medium.open()
    puppet = medium.puppet()
    puppet.offer(1)
    assert next_of(left).arbitration_id == 1
    puppet.signal(signal.SIGKILL)
    left.send(standard(2))
    assert ids_until(right, 2) == [1, 2]


def test_a_stopped_client_slows_no_other_and_costs_no_other_a_frame(medium: Medium) -> None:
    puppet = medium.puppet()
    puppet.signal(signal.SIGSTOP)
    senders = [medium.open(receive_own_messages=True) for _ in range(4)]
    each = 1500 if medium.address["interface"] == "softbus" else 400  # Linux keeps a few hundred for a stopped process
    heard = talk_all_at_once(senders, medium.open(), frames_each=each)
    assert len({(m.arbitration_id, bytes(m.data)) for m in heard}) == 4 * each
    puppet.signal(signal.SIGCONT)
    puppet.offer(0x7F)
    assert ids_until(senders[0], 0x7F)


def test_the_frames_that_a_stopped_client_missed_are_counted(hub_at: Callable) -> None:
    _, medium = hub_at(1_000_000)
    puppet = medium.puppet()
    puppet.signal(signal.SIGSTOP)
    senders = [medium.open(receive_own_messages=True) for _ in range(4)]
    talk_all_at_once(senders, medium.open(), frames_each=1500)
    lost = {client.pid: client.overruns for client in senders[0].statistics().clients}
    assert lost[puppet.pid] > 0
    assert lost[os.getpid()] == 0


def test_contending_frames_go_by_priority_and_take_their_exact_time(hub_at: Callable) -> None:
    bitrate = 1_000  # the first frame occupies the bus for 130 ms: all the others are offered meanwhile
    _, medium = hub_at(bitrate)
    watcher = medium.open()
    contenders = [
        can.Message(arbitration_id=0x080 << 18),  # 29 bits, and yet before the standard 0x100
        standard(0x300, b"\xff"),
        standard(0x100),
        can.Message(arbitration_id=0x100 << 18),  # same base as the standard 0x100: SRR and IDE lose
        can.Message(arbitration_id=0x300, is_extended_id=False, is_remote_frame=True),
        standard(0x001),
    ]
    buses = [medium.open() for _ in contenders]
    blocker = medium.open()
    before = watcher.statistics()
    blocker.send(standard(0x7FF, bytes(8)))
    for bus, message in zip(buses, contenders, strict=True):
        bus.send(message)
    heard = [next_of(watcher) for _ in range(7)]
    assert [(m.arbitration_id, m.is_extended_id, m.is_remote_frame) for m in heard] == [
        (0x7FF, False, False),
        (0x001, False, False),
        (0x080 << 18, True, False),
        (0x100, False, False),
        (0x100 << 18, True, False),
        (0x300, False, False),
        (0x300, False, True),
    ]
    for earlier, later in pairwise(heard):
        assert later.timestamp - earlier.timestamp == pytest.approx(length_bits(later) / bitrate, abs=1e-6)
    after = watcher.statistics()
    assert after.busy_ns - before.busy_ns == sum(length_bits(m) for m in heard) * 1_000_000
    assert after.frames - before.frames == len(heard)


def test_at_full_load_frames_follow_each_other_and_never_overlap(hub_at: Callable) -> None:
    _, medium = hub_at(100_000)  # a frame takes a millisecond: eight senders keep up on any computer
    senders = [medium.open(receive_own_messages=True) for _ in range(8)]
    heard = talk_all_at_once(senders, medium.open(), frames_each=60)
    gaps_us = [
        (later.timestamp - earlier.timestamp) * 1e6 - 10 * length_bits(later) for earlier, later in pairwise(heard)
    ]
    assert min(gaps_us) > -1  # a float of seconds since 1970 is good to a quarter of a microsecond
    assert any(abs(gap) < 1 for gap in gaps_us)


def test_a_full_mailbox_refuses_a_sender_that_will_not_wait(hub_at: Callable) -> None:
    hub, medium = hub_at(1_000_000)
    sender, watcher = medium.open(), medium.open()
    os.kill(hub.pid, signal.SIGSTOP)
    sender.send(standard(1))
    with pytest.raises(can.CanOperationError, match="still waiting"):
        sender.send(standard(2), timeout=0)
    os.kill(hub.pid, signal.SIGCONT)
    sender.send(standard(3))
    assert ids_until(watcher, 3) == [1, 3]


def test_what_a_dead_client_had_offered_vanishes(hub_at: Callable) -> None:
    _, medium = hub_at(1_000)
    blocker, watcher, puppet = medium.open(), medium.open(), medium.puppet()
    blocker.send(standard(0x7FF, bytes(8)))
    puppet.offer(0x001)
    puppet.signal(signal.SIGKILL)
    blocker.send(standard(0x7FE))
    assert ids_until(watcher, 0x7FE) == [0x7FF, 0x7FE]
    assert puppet.pid not in {client.pid for client in watcher.statistics().clients}


def test_the_end_of_the_hub_reaches_every_client(hub_at: Callable) -> None:
    hub, medium = hub_at(1_000_000)
    waiting, idle = medium.open(), medium.open()
    with ThreadPoolExecutor(1) as pool:
        wait = pool.submit(waiting.recv)
        hub.kill()
        with pytest.raises(can.CanOperationError, match=r"bus is gone.*heronry softbus"):
            wait.result(PATIENCE_S)
    assert select.select([idle], [], [], PATIENCE_S)[0] == [idle]
    with pytest.raises(can.CanOperationError, match="bus is gone"):
        idle.recv(0)
    with pytest.raises(can.CanOperationError, match="bus is gone"):
        idle.send(standard(1))


def test_timestamps_are_those_of_the_system_clock(hub_at: Callable) -> None:
    _, medium = hub_at(1_000_000)
    sender, receiver = medium.open(), medium.open()
    sender.send(standard(1))
    now_s = Path(medium.address["channel"]).stat().st_ctime
    assert abs(next_of(receiver).timestamp - now_s) < 60
