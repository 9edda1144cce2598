"""Serves the metrics of a live or recorded system to a Prometheus on this computer.

There is one page, on the loopback address only. A caller has PATIENCE_S to send its request and to read the answer. If
there are MOST_CALLERS, the one that came first makes room for a new one.
"""

import asyncio
import re
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from heronry_tools.console.errors import UserError
from heronry_tools.watch.metrics import CONTENT_TYPE, exposition
from heronry_tools.watch.top.sources import TopSource
from heronry_wire.interruption import noted

PATIENCE_S: Final = 2.0
MOST_CALLERS: Final = 32
_AT_ONCE: Final = 32  # callers that the event loop accepts in one turn
_LONGEST_REQUEST_BYTES: Final = 8192
_LOOK_S: Final = 0.1
_ASKS: Final = re.compile(rb"GET /metrics(\?\S*)? HTTP/1\.[01]\r\n")

Page = Callable[[], bytes]


def serve(source: TopSource, port: int) -> None:
    """Serve the metrics of `source` until SIGINT or SIGTERM.

    Raises UserError if the port cannot be used.
    """
    stopped = noted()
    listener = socket.socket()
    with listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            raise UserError(f"port {port} cannot be used ({error}): name another one with --port") from error
        asyncio.run(_serve(source, listener, stopped))


async def _serve(source: TopSource, listener: socket.socket, stopped: list[int]) -> None:
    callers = _Callers(lambda: exposition(source.snapshot()))
    server = await asyncio.start_server(callers.answer, sock=listener, limit=_LONGEST_REQUEST_BYTES, backlog=_AT_ONCE)
    print(f"http://127.0.0.1:{listener.getsockname()[1]}/metrics", flush=True)
    while not stopped:
        await _readable(source)
        source.look()
    server.close()
    callers.drop_all()


async def _readable(source: TopSource) -> None:
    """Wait until `source` has something to read, or for _LOOK_S."""
    woken, loop, readers = asyncio.Event(), asyncio.get_running_loop(), source.readers()
    for reader in readers:
        loop.add_reader(reader, woken.set)
    with suppress(TimeoutError):
        async with asyncio.timeout(_LOOK_S):
            await woken.wait()
    for reader in readers:
        loop.remove_reader(reader)


class _Callers:
    """The callers of the page: each is answered once and dropped."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._present: dict[asyncio.StreamWriter, None] = {}  # in the order in which they came

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer a caller with the present metrics, unless it is too slow."""
        if len(self._present) >= MOST_CALLERS:
            next(iter(self._present)).transport.abort()
        self._present[writer] = None
        with suppress(OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            async with asyncio.timeout(PATIENCE_S):
                request = await reader.readuntil(b"\r\n\r\n")
                writer.write(self._answer_to(request))
                writer.close()
                await writer.wait_closed()
        writer.transport.abort()
        self._present.pop(writer, None)

    def drop_all(self) -> None:
        """Drop every caller."""
        for writer in self._present:
            writer.transport.abort()

    def _answer_to(self, request: bytes) -> bytes:
        is_it = _ASKS.match(request) is not None
        status, kind = ("200 OK", CONTENT_TYPE) if is_it else ("404 Not Found", "text/plain; charset=utf-8")
        body = self._page() if is_it else b"the metrics are at /metrics\n"
        head = f"HTTP/1.0 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n"
        return head.encode() + body
