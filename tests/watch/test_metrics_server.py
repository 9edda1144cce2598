"""One caller cannot hold the page of metrics: neither other callers nor a signal wait for it."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from urllib.request import urlopen

import pytest

from heronry_tools.watch.metrics_server import MOST_CALLERS
from watch.flights import big_blue_log

PATIENCE_S = 30.0


class Served:
    """A process that serves the metrics of a recorded flight."""

    def __init__(self) -> None:
        words = ("metrics", "--log", str(big_blue_log()), "big_blue", "--port", "0")
        self.process = subprocess.Popen([sys.executable, "-m", "heronry_tools", *words], stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().decode().strip()
        self.port = int(self.address.removesuffix("/metrics").rpartition(":")[2])

    def calling(self, words: bytes = b"") -> socket.socket:
        caller = socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)
        caller.sendall(words)
        return caller

    def is_answered(self) -> bool:
        with urlopen(self.address, timeout=PATIENCE_S) as page:
            return b"heronry_" in page.read()


@pytest.fixture
def served() -> Iterator[Served]:
    serving = Served()
    try:
        yield serving
    finally:
        serving.process.kill()
        serving.process.communicate(timeout=PATIENCE_S)


def test_a_caller_that_sends_half_a_request_stands_in_nobodys_way(served: Served) -> None:
    with ExitStack() as held:
        callers = [held.enter_context(served.calling(b"GET /me")) for _ in range(MOST_CALLERS + 8)]
        assert served.is_answered()
        for caller in callers:  # too many, or too slow
            with suppress(ConnectionResetError):
                assert caller.recv(1) == b""


def test_a_signal_does_not_wait_for_a_caller(served: Served) -> None:
    with served.calling(b"GET /metrics HTTP/1.1\r\n") as dripping:
        served.process.terminate()
        for _ in range(20):
            with suppress(ConnectionError):
                dripping.sendall(b"X: y\r\n")
            with suppress(subprocess.TimeoutExpired):
                assert served.process.wait(0.5) == 0
                return
    raise AssertionError("it waits for the caller")


@pytest.mark.parametrize("words", [b"POST /metrics HTTP/1.1", b"GET /\xff HTTP/1.1", b"\0", b"GET"])
def test_what_asks_for_no_metrics_is_told_where_they_are(served: Served, words: bytes) -> None:
    with served.calling(words + b"\r\n\r\n") as caller:
        assert caller.recv(4096).startswith(b"HTTP/1.0 404")
