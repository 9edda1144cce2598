"""One caller cannot hold the door: connections that send nothing, too slowly or nonsense leave room for others."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from heronry_tools.web import connections
from heronry_tools.web.connections import MOST_CONNECTIONS
from web.browser import Server, recorded

ASKING = "GET /api/facts HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}\r\n"


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(recorded()) as serving:
        yield serving


def calling(server: Server, words: str = "") -> socket.socket:
    caller = socket.create_connection(("127.0.0.1", server.access.port), timeout=20)
    caller.sendall(words.encode())
    return caller


def is_answered(server: Server) -> bool:
    with calling(server, ASKING.format(server.access.port, "Connection: close\r\n")) as caller:
        return caller.recv(15) == b"HTTP/1.1 200 OK"


def was_dropped(caller: socket.socket) -> bool:
    try:
        return caller.recv(1) == b""
    except ConnectionResetError:
        return True


def test_idle_connections_make_room_for_the_newest(server: Server) -> None:
    with ExitStack() as idle:
        callers = [idle.enter_context(calling(server)) for _ in range(MOST_CONNECTIONS + 40)]
        assert is_answered(server)
        assert all(was_dropped(caller) for caller in callers[:40])


def test_streams_make_room_for_the_newest_only_after_all_that_wait_for_nothing(server: Server) -> None:
    stream = f"GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1:{server.access.port}\r\n\r\n"
    with ExitStack() as held:
        streams = [held.enter_context(calling(server, stream)) for _ in range(4)]
        for one in streams:
            assert one.recv(15) == b"HTTP/1.1 200 OK"
        idle = [held.enter_context(calling(server)) for _ in range(MOST_CONNECTIONS)]
        assert is_answered(server)
        assert was_dropped(idle[0])
        assert all(one.recv(1) for one in streams)
        more = [held.enter_context(calling(server, stream)) for _ in range(MOST_CONNECTIONS)]
        assert more[-1].recv(15) == b"HTTP/1.1 200 OK"
        assert is_answered(server)


BODY = (
    "POST /api/ask HTTP/1.1\r\nHost: 127.0.0.1:{0}\r\nOrigin: http://127.0.0.1:{0}\r\n"
    "Content-Type: application/json\r\n"
)
SLOW = {
    "nothing": "",
    "half a head": "GET / HTTP/1.1\r\nHost: a",
    "half a body": BODY + "Content-Length: 10\r\n\r\n{{",
}


@pytest.mark.parametrize("sent", SLOW.values(), ids=list(SLOW))
def test_a_request_must_come_in_full_in_its_time(sent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 0.3)
    with Server(recorded()) as server, calling(server, sent.format(server.access.port)) as caller:
        assert was_dropped(caller)


def test_a_second_request_must_come_in_its_time_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 0.3)
    with Server(recorded()) as server, calling(server) as caller:
        caller.sendall(f"GET /page/none HTTP/1.1\r\nHost: 127.0.0.1:{server.access.port}\r\n\r\n".encode())
        assert caller.recv(65_536).startswith(b"HTTP/1.1 404")
        caller.sendall(b"GET / HTTP/1.1\r\nHost: a")
        while not was_dropped(caller):
            pass  # the rest of the first answer


def test_bad_requests_write_no_log(server: Server, capfd: pytest.CaptureFixture[str]) -> None:
    for words in ("\0\r\n\r\n", ASKING.format(server.access.port, "Connection: upgrade\r\nUpgrade: websocket\r\n")):
        with calling(server, words) as caller:
            assert caller.recv(8) == b"HTTP/1.1"
    assert capfd.readouterr() == ("", "")
