"""The life of a hub: its place in the file system, its end, and clients that break its protocol."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from heronry_tools.runtime.softbus.address import HubError
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.hub import MAX_CLIENTS
from heronry_tools.runtime.softbus.place import BusNameError, path_to_listen
from heronry_tools.runtime.softbus.protocol import PROTOCOL_VERSION, BusFrame, encode_command, encode_frame
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from heronry_wire.frame import Frame
from heronry_wire.runtime_folder import RuntimeFolderError

PATIENCE_S = 10.0
HELLO = {"do": "hello", "protocol": PROTOCOL_VERSION, "own": False}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bus"


@pytest.fixture
def hub(path: Path) -> Iterator[HubProcess]:
    with start_hub(path) as process:
        yield process


def assert_carries_frames(path: Path) -> None:
    with SoftBus(str(path)) as sender, SoftBus(str(path)) as receiver:
        sender.send(can.Message(arbitration_id=0x123))
        received = receiver.recv(PATIENCE_S)
    assert received is not None
    assert received.arbitration_id == 0x123


@pytest.mark.parametrize("name", ["bad name", ".", "a:b", "-x", "x" * 40, "caf\u00e9"])
def test_what_is_no_name_of_a_bus_is_refused_by_hub_and_client(name: str) -> None:
    with pytest.raises(BusNameError, match="is no name of a bus; write letters, digits"):
        path_to_listen(name)
    with pytest.raises(can.CanInitializationError, match="is no name of a bus"):
        SoftBus(name)


def test_without_a_hub_the_error_says_how_to_start_one(path: Path) -> None:
    with pytest.raises(can.CanInitializationError, match=rf"no bus answers there.*: heronry softbus {path}$"):
        SoftBus(str(path))


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"channel": None}, "needs a channel"),
        ({"bitrate": 500_000}, "runs at 1000000 bit/s, not at 500000"),
        ({"fd": True}, "not CAN FD"),
    ],
)
def test_what_the_bus_cannot_be_is_refused(hub: HubProcess, options: dict[str, object], complaint: str) -> None:
    with pytest.raises(can.CanInitializationError, match=complaint):
        SoftBus(**{"channel": str(hub.path), **options})


def test_the_right_bit_rate_may_be_given(hub: HubProcess) -> None:
    SoftBus(str(hub.path), bitrate=1_000_000).shutdown()


@pytest.mark.parametrize(
    "message",
    [
        can.Message(is_fd=True),
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=0x800, is_extended_id=False),
        can.Message(arbitration_id=0x2000_0000),
        can.Message(data=bytes(9)),
        can.Message(data=bytes(3), dlc=4),
    ],
    ids=str,
)
def test_what_is_no_frame_is_not_sent(hub: HubProcess, message: can.Message) -> None:
    with SoftBus(str(hub.path)) as bus, pytest.raises(ValueError, match=r"carries|does not fit|dlc"):
        bus.send(message)


def test_a_second_hub_is_refused_and_the_first_goes_on(hub: HubProcess) -> None:
    with pytest.raises(HubError, match=r"a software bus runs at .* already"):
        start_hub(hub.path)
    assert_carries_frames(hub.path)


def test_the_socket_of_a_crashed_hub_is_taken_over(hub: HubProcess) -> None:
    hub.kill()
    assert hub.path.is_socket()
    with start_hub(hub.path):
        assert_carries_frames(hub.path)
    assert not hub.path.exists()


def test_a_hub_leaves_the_socket_of_its_successor_alone(hub: HubProcess) -> None:
    hub.path.unlink()
    with start_hub(hub.path):
        hub.close()
        assert_carries_frames(hub.path)


def test_a_file_is_never_overwritten(path: Path) -> None:
    path.write_text("precious")
    with pytest.raises(HubError, match="not a socket; choose another path"):
        start_hub(path)
    assert path.read_text() == "precious"


@pytest.mark.parametrize("place", ["missing/bus", "x" * 200])
def test_an_impossible_place_is_refused_in_a_sentence(tmp_path: Path, place: str) -> None:
    with pytest.raises(HubError, match="no software bus can run at"):
        start_hub(tmp_path / place)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_hub_that_is_asked_to_end_cleans_up(path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "heronry_tools", "softbus", str(path), "-b", "125000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert re.fullmatch(rf"[0-9:.]{{12}} {path}: 125000 bit/s; .*\n", process.stdout.readline())
        with SoftBus(str(path), bitrate=125_000):
            process.send_signal(number)
            assert process.wait(PATIENCE_S) == 0
    assert not path.exists()


@pytest.mark.parametrize("bitrate", ["fast", "0", "2000000", "-1"])
def test_an_odd_bit_rate_is_refused_in_a_sentence(path: Path, bitrate: str) -> None:
    command = [sys.executable, "-m", "heronry_tools", "softbus", str(path), f"--bitrate={bitrate}"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "is not a bit rate from 1000 to 1000000 bit/s" in result.stderr


def test_a_hub_never_outlives_a_starter_that_is_killed(path: Path) -> None:
    starter = (
        "import sys, time; from heronry_tools.runtime.softbus.starter import start_hub\n"
        "hub = start_hub(sys.argv[1]); print(hub.pid, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", starter, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip().isdecimal()
        with SoftBus(str(path)) as bus:
            process.kill()
            with pytest.raises(can.CanOperationError, match="bus is gone"):
                bus.recv(PATIENCE_S)
    assert not path.exists()


def test_a_bus_with_a_name_is_found_by_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(can.CanInitializationError, match=r"^can0: no bus answers there.*: heronry softbus can0$"):
        SoftBus("can0")
    command = [sys.executable, "-m", "heronry_tools", "softbus", "--until-eof"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert re.fullmatch(r"[0-9:.]{12} can0: 1000000 bit/s; .* -i softbus -c can0\n", process.stdout.readline())
        with SoftBus("can0") as sender, SoftBus("can0") as receiver:
            sender.send(can.Message(arbitration_id=0x123))
            assert receiver.recv(PATIENCE_S) is not None
        with pytest.raises(can.CanInitializationError, match=r"heronry softbus radio   \(there is: can0\)$"):
            SoftBus("radio")
        assert (tmp_path / "heronry").stat().st_mode & 0o777 == 0o700


def test_a_name_is_not_looked_up_in_a_folder_that_others_can_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = tmp_path / "heronry"
    folder.mkdir()
    folder.chmod(0o777)
    with start_hub(folder / "can0.bus"):
        with pytest.raises(can.CanInitializationError, match="other users can write to it: name the bus by a path"):
            SoftBus("can0")
        SoftBus(str(folder / "can0.bus")).shutdown()
    ran = subprocess.run(
        [sys.executable, "-m", "heronry_tools", "softbus"], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stdout) == (2, "")
    assert "other users can write to it: name the bus by a path, such as ./can0.sock" in ran.stderr
    with pytest.raises(RuntimeFolderError, match="name the bus by a path"):
        path_to_listen("can0")


class RawClient:
    """A client that sends any bytes."""

    def __init__(self, path: Path) -> None:
        self.command = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.command.settimeout(PATIENCE_S)
        self.command.connect(str(path))
        self.receive, self.hub_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def say(self, record: bytes, *descriptors: int) -> bytes:
        socket.send_fds(self.command, [record], list(descriptors))
        return self.command.recv(1000)

    def join(self) -> None:
        assert b"bitrate" in self.say(encode_command(HELLO), self.hub_end.fileno())

    def __enter__(self) -> "RawClient":
        return self

    def __exit__(self, *_: object) -> None:
        for each in (self.command, self.receive, self.hub_end):
            each.close()


@pytest.mark.parametrize(
    ("hello", "complaint"),
    [
        (b"rubbish", b"not a hello"),
        (b"{}", b"not a hello"),
        (encode_command({"do": "statistics"}), b"not a hello"),
        (encode_command({**HELLO, "protocol": 1}), b"speaks protocol 3"),
    ],
)
def test_a_client_learns_what_is_wrong_with_its_hello(hub: HubProcess, hello: bytes, complaint: bytes) -> None:
    with RawClient(hub.path) as stranger:
        assert complaint in stranger.say(hello, stranger.hub_end.fileno())
        assert stranger.command.recv(1000) == b""
    assert_carries_frames(hub.path)


def test_a_hello_without_a_socket_is_refused(hub: HubProcess) -> None:
    with RawClient(hub.path) as stranger:
        assert b"not a hello" in stranger.say(encode_command(HELLO))
    with RawClient(hub.path) as stranger, Path(os.devnull).open() as nothing:
        assert b"no socket" in stranger.say(encode_command(HELLO), nothing.fileno())
    assert_carries_frames(hub.path)


@pytest.mark.parametrize(
    ("record", "complaint"),
    [
        (b"rubbish", b"a frame record has"),
        (b"{", b"unknown command"),
        (encode_command({"do": "dance"}), b"unknown command"),
        (encode_command({"do": "filters", "filters": [[1]]}), b"is not a filter"),
        (encode_frame(BusFrame(Frame(0x800, b""), 0, 0)), b"more than 11 bits"),
        (encode_frame(BusFrame(Frame(1, b""), 9, 0)), b"at most 8 bytes"),
    ],
)
def test_a_client_that_breaks_the_rules_gets_the_reason_and_is_removed(
    hub: HubProcess, record: bytes, complaint: bytes
) -> None:
    with RawClient(hub.path) as rude:
        rude.join()
        assert complaint in rude.say(record)
        assert rude.command.recv(1000) == b""
    assert_carries_frames(hub.path)


def test_a_client_that_offers_a_second_frame_too_early_is_removed(path: Path) -> None:
    with start_hub(path, bitrate=1_000) as hub, RawClient(hub.path) as hasty, SoftBus(str(path)) as other:
        hasty.join()
        offer = encode_frame(BusFrame(Frame(0x7FF, bytes(8)), 8, 0))
        hasty.command.send(offer)
        assert b"before the last one had left" in hasty.say(offer)
        on_air = other.recv(PATIENCE_S)
        assert on_air is not None
        assert on_air.arbitration_id == 0x7FF


def test_a_client_that_joined_and_set_no_filters_yet_hears_nothing(hub: HubProcess) -> None:
    with RawClient(hub.path) as receive_failed:
        receive_failed.join()
        assert_carries_frames(hub.path)
        receive_failed.receive.setblocking(False)
        with pytest.raises(BlockingIOError):
            receive_failed.receive.recv(100)


def test_a_full_bus_refuses_one_more_client(hub: HubProcess) -> None:
    strangers = []
    try:
        for _ in range(MAX_CLIENTS):
            strangers.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            strangers[-1].connect(str(hub.path))
        with pytest.raises(can.CanInitializationError, match="400 clients already"):
            SoftBus(str(hub.path))
    finally:
        for stranger in strangers:
            stranger.close()
    assert_carries_frames(hub.path)


def test_a_bus_can_be_made_a_bad_radio_and_a_good_one_again(hub: HubProcess) -> None:
    with SoftBus(str(hub.path), receive_own_messages=True) as sender, SoftBus(str(hub.path)) as receiver:
        sender.disturb(slowdown=20, loss_per_mille=1000)
        sender.send(can.Message(arbitration_id=0x123, data=bytes(8)))
        first = sender.recv(PATIENCE_S)
        sender.send(can.Message(arbitration_id=0x124, data=bytes(8)))
        second = sender.recv(PATIENCE_S)
        assert first is not None
        assert second is not None
        assert second.timestamp - first.timestamp > 20 * 100e-6, "each takes twenty times its 110 us or more"
        sender.disturb()
        sender.send(can.Message(arbitration_id=0x125))
        received = receiver.recv(PATIENCE_S)
        assert received is not None
        assert received.arbitration_id == 0x125, "the others have missed it"


def test_what_no_bus_can_be_is_refused(hub: HubProcess) -> None:
    with SoftBus(str(hub.path)) as bus, pytest.raises(can.CanOperationError, match="unknown command"):
        bus.disturb(slowdown=0)
