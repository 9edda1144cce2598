"""Runs the server of the pages: the socket, the address that is printed, and the end on a signal.

SIGINT, SIGTERM or SIGHUP end the server in order: every stream is closed, and the planner's process is ended.
"""

import asyncio
import secrets
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import uvicorn

from heronry_tools.console.errors import UserError
from heronry_tools.web.app import Site, application
from heronry_tools.web.connections import LimitedConnection
from heronry_tools.web.guard import Access

USUAL_PORT: Final = 8321
_LONGEST_END_S: Final = 2
_AT_ONCE: Final = 64  # connections that the event loop accepts in one turn, before it looks at their number


def listening(address: str, port: int | None) -> socket.socket:
    """Open the server's socket, on an address or a name of this computer.

    port: None for USUAL_PORT, or for a free port if USUAL_PORT is taken.
    Raises UserError if the address or the port cannot be used.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    for number in (USUAL_PORT, 0) if port is None else (port,):
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address, number))
        except OSError as error:
            listener.close()
            if port is None and number:
                continue
            flags = f"--listen {address}" if port is None else f"--listen {address} --port {port}"
            raise UserError(f"{flags}: {error.strerror}; name another address or port") from None
        listener.listen(_AT_ONCE)
        return listener
    raise AssertionError("unreachable: the kernel gives a free port, or an error")


def access(listener: socket.socket, *, operates: bool) -> Access:
    """Return the access rules of a server, with a new token; `operates`: whether its pages may give orders."""
    address, port = listener.getsockname()[:2]
    return Access(address, port, secrets.token_urlsafe(24), operates)


class _Server(uvicorn.Server):
    """A server that ends on a signal, and does not raise the signal again: being stopped is its usual end."""

    def __init__(self, config: uvicorn.Config, closing: asyncio.Event) -> None:
        super().__init__(config)
        self._closing = closing

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Let SIGINT, SIGTERM and SIGHUP end the server; a signal that the process ignores stays ignored."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                loop.add_signal_handler(number, self.stop)
        yield

    def stop(self) -> None:
        """End the server; its streams first, so that it need not wait for them."""
        self._closing.set()
        self.should_exit = True


def serve(site: Site, listener: socket.socket, begun: Callable[[], None]) -> None:
    """Serve the pages of `site` at `listener` until a signal comes.

    begun: is called in the event loop as soon as the server can answer requests.
    """
    _Server(configuration(site, begun), site.closing).run(sockets=[listener])


def configuration(site: Site, begun: Callable[[], None] = lambda: None) -> uvicorn.Config:
    """Return uvicorn's settings for the pages of `site`.

    begun: is called in the event loop as soon as the server can answer requests.
    """
    return uvicorn.Config(
        application(site, begun),
        http=LimitedConnection,
        backlog=_AT_ONCE,
        log_level="error",  # a warning tells of one caller's bad request: any caller could fill the log with them
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=_LONGEST_END_S,
        lifespan="on",
    )
