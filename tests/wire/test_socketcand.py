"""A bus behind a socketcand: TCP, through python-can, with a server that speaks the protocol and can go away."""

import gc
import select
import socket
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from threading import Thread

import pytest

from heronry_wire import socketcand
from heronry_wire.bus_opening import LinkError, open_bus
from heronry_wire.frame import Frame
from heronry_wire.link import Link

PATIENCE_S = 10.0


class Server:
    """One client at a time: it is greeted, opens `can0` and goes to raw mode, as socketcand's protocol says."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listening.getsockname()[1]}"
        self.heard = b""
        self.client: socket.socket | None = None

    def expect(self) -> Thread:
        thread = Thread(target=self._greet, daemon=True)
        thread.start()
        return thread

    def _greet(self) -> None:
        while True:
            client = self._listening.accept()[0]
            with suppress(ConnectionError):  # a client that only tests the connection closes it
                client.sendall(b"< hi >")
                if client.recv(100) == b"< open can0 >":
                    break
            client.close()
        client.sendall(b"< ok >")
        assert client.recv(100) == b"< rawmode >"
        client.sendall(b"< ok >")
        self.client = client

    def close(self) -> None:
        self._listening.close()
        if self.client is not None:
            self.client.close()


@pytest.fixture
def server() -> Iterator[Server]:
    with closing(Server()) as opened:
        yield opened


def linked(server: Server) -> Link:
    greeting = server.expect()
    joined = Link({"interface": "socketcand", "channel": f"can0@{server.address}"})
    greeting.join(PATIENCE_S)
    return joined


def test_frames_come_and_go_and_none_is_left_lying(server: Server) -> None:
    with closing(linked(server)) as joined:
        assert server.client is not None
        server.client.sendall(b"< frame 123 1.5 0102 >< frame 7ff 1.6  >< fra")
        select.select([joined], [], [], PATIENCE_S)
        arrivals = joined.receive(time.monotonic_ns())
        assert [arrival.frame for arrival in arrivals] == [Frame(0x123, b"\1\2"), Frame(0x7FF, b"")]
        assert time.monotonic_ns() - arrivals[0].time_ns < 1_000_000_000  # dated by this machine's clock
        server.client.sendall(b"me 001 1.7 ff >")
        select.select([joined], [], [], PATIENCE_S)
        assert [arrival.frame for arrival in joined.receive(time.monotonic_ns())] == [Frame(1, b"\xff")]
        joined.send(Frame(0x0C8, b"\x0a\xff"), time.monotonic_ns())
        assert server.client.recv(100) == b"< send 0C8 2 a ff >"
        assert joined.all_left  # nothing is echoed, so nothing is waited for
        assert joined.departures_ns() == [0]


def test_frames_of_other_identifiers_hide_none_that_the_node_takes(server: Server) -> None:
    with closing(linked(server)) as joined:
        assert server.client is not None
        joined.accept({0x0C9})
        joined.send(Frame(0x0C8, b""), time.monotonic_ns())  # its echo would be let in, and none comes
        for number in range(3):
            unwanted = b"< frame 123 1.5 01 >" * 4 + b"< frame 000000C9 1.5 01 >"
            server.client.sendall(unwanted + b"< frame 0C9 1.5 %02x >" % number)
            select.select([joined], [], [], PATIENCE_S)
            arrivals = joined.receive(time.monotonic_ns())
            assert [arrival.frame for arrival in arrivals] == [Frame(0x0C9, bytes([number]))]
            assert not joined.has_more
        server.client.sendall(b"< frame 123 1.5 01 >" * 64 + b"< frame 0C9 1.5 ff >")
        until_s, heard = time.monotonic() + PATIENCE_S, []
        while not heard:
            assert time.monotonic() < until_s
            assert joined.has_more or select.select([joined], [], [], PATIENCE_S)[0]
            heard = joined.receive(time.monotonic_ns())
        assert [arrival.frame for arrival in heard] == [Frame(0x0C9, b"\xff")]


def test_what_is_no_frame_hides_none(server: Server) -> None:
    with closing(linked(server)) as joined:
        assert server.client is not None
        server.client.sendall(b"< hi >" * 400 + b"< frame 0C9 1.5 01 >")  # read 1 024 bytes at a time
        time.sleep(0.1)  # loopback: all of it is there
        assert [arrival.frame for arrival in joined.receive(time.monotonic_ns())] == [Frame(0x0C9, b"\1")]


def test_a_server_that_goes_away_is_a_lost_bus_and_is_found_again(server: Server) -> None:
    with closing(linked(server)) as joined:
        assert server.client is not None
        server.client.close()
        select.select([joined], [], [], PATIENCE_S)
        assert joined.receive(time.monotonic_ns()) == []
        assert not joined.is_open
        assert "the socketcand server has closed the connection" in " ".join(joined.take_link_events())
        server.expect()
        until_s = time.monotonic() + PATIENCE_S
        while not joined.readers:
            assert time.monotonic() < until_s
            joined.pump(time.monotonic_ns())
            select.select([], [], [], 0.02)


@pytest.mark.parametrize("channel", ["can0@nowhere", "can0@host:", "@host:29536", "can0@:29536", "can0@host:port"])
def test_a_server_that_is_not_named_is_one_sentence(channel: str) -> None:
    with pytest.raises(LinkError, match="a socketcand bus is named INTERFACE@HOST:PORT"):
        open_bus({"interface": "socketcand", "channel": channel})


def test_a_missing_server_is_one_sentence_immediately() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(LinkError, match="refused"):
        open_bus({"interface": "socketcand", "channel": f"can0@127.0.0.1:{port}"})


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can leaves its socket open
def test_a_server_that_says_nothing_is_not_waited_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socketcand, "SERVER_S", 0.2)
    with closing(socket.create_server(("127.0.0.1", 0))) as transmit_failed:
        channel = f"can0@127.0.0.1:{transmit_failed.getsockname()[1]}"
        with pytest.raises(LinkError, match="timed out"):
            open_bus({"interface": "socketcand", "channel": channel})
    gc.collect()
    assert socket.getdefaulttimeout() is None
