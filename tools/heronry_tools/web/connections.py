"""The connections of callers: how many there are at a time, and how long one may take to send a request.

uvicorn limits the time between two requests of a connection, but not the time before the first one, and not that of a
request whose bytes come one by one. Here a request with its body must have come REQUEST_S after the connection was
opened, or after the request's first byte.

If there are MOST_CONNECTIONS, the oldest one that waits for no answer makes room for a new one. If all of them wait for
an answer (each open page waits at its stream), the oldest of all makes room; a page opens its stream again.
"""

import asyncio
from itertools import count
from typing import Any, Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS: Final = 128  # a process can usually open 1024 files
REQUEST_S: Final = 10.0

_numbers = count()


class LimitedConnection(H11Protocol):
    """A connection of uvicorn with these limits."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.number = next(_numbers)
        self._limit: asyncio.TimerHandle | None = None  # runs while a request is to come

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request; make room if there are too many connections."""
        super().connection_made(transport)
        self._limit = self.loop.call_later(REQUEST_S, transport.abort)
        while len(self.connections) > MOST_CONNECTIONS:
            others = [one for one in self.connections if isinstance(one, LimitedConnection) and one is not self]
            oldest = min(others, key=lambda one: (one.waits_for_answer, one.number))
            self.connections.discard(oldest)
            oldest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take bytes of a request; the time limit ends with the last byte, and begins with the first of the next."""
        super().data_received(data)
        if self.waits_for_answer:
            self._end_limit()
        elif self._limit is None:
            self._limit = self.loop.call_later(REQUEST_S, self.transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """End the time limit."""
        self._end_limit()
        super().connection_lost(exc)

    @property
    def waits_for_answer(self) -> bool:
        """Tell whether a request has come in full, and its answer has not been sent in full."""
        return self.conn.their_state in (h11.DONE, h11.MUST_CLOSE)

    def _end_limit(self) -> None:
        if self._limit is not None:
            self._limit.cancel()
            self._limit = None
