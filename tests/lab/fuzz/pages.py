"""What a browser, or another program, may send to the server of the page: requests, questions and orders."""

import asyncio
import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from heronry_dg.shipped import shipped_spec_path
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.app import Site, application
from heronry_tools.web.desk import Desk
from heronry_tools.web.guard import Access, Guard
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording
from lab.fuzz.decoders import spec
from lab.fuzz.recordings import flight
from lab.fuzz.target import Target

_TOKEN, _PORT = "t0ken", 8321
_ORIGIN = f"http://127.0.0.1:{_PORT}"


@cache
def _desk() -> Desk:
    return Desk(spec())


class _Asked(Questions):
    """Questions that this process answers itself, so that an exception of the desk is one of the target."""

    async def ask(self, question: Any) -> dict[str, Any]:
        """Answer as the planner's process does; a plan takes too long here."""
        if question.get("ask") == "plan":
            return {"refused": "no plans here"}
        return _desk().answer(question)


@cache
def _application() -> Guard:
    shown = Recording(Reducer(spec()), flight().events, "log")
    questions = _Asked(spec(), shipped_spec_path("elevator_and_chute"))
    access = Access("127.0.0.1", _PORT, _TOKEN, operates=True)
    return application(Site(spec(), shown, questions, Orders(None), access, flight().frames[:3]))


def _request(data: bytes) -> None:
    """Send a request: its first line, headers up to an empty line, and its body; as a server would pass it on."""
    head, _, body = data.partition(b"\r\n\r\n")
    first, *lines = head.split(b"\r\n")
    method, _, target = first.partition(b" ")
    path, _, query = target.partition(b"?")
    headers = [tuple(part.strip() for part in line.partition(b":")[::2]) for line in lines]
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "scheme": "http",
        "method": method.decode("latin-1"),
        "path": path.decode("utf-8", "replace"),
        "raw_path": path,
        "query_string": query,
        "root_path": "",
        "headers": [(name.lower(), value) for name, value in headers],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", _PORT),
    }
    asyncio.run(_served(scope, body))


async def _served(scope: dict[str, Any], body: bytes) -> None:
    """Serve one request; the caller goes away after the first part of an answer that has no end."""
    incoming = [{"type": "http.request", "body": body, "more_body": False}]
    parts: list[int] = []

    async def receive() -> dict[str, Any]:
        return incoming.pop(0) if incoming else {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        parts.append(message.get("status", 0))

    await _application()(scope, receive, send)
    assert parts, "every request is answered"


def _question(data: bytes) -> None:
    """Ask the planner's process; it gets JSON objects alone."""
    try:
        asked = json.loads(data)
    except (ValueError, RecursionError):
        return
    if isinstance(asked, dict) and asked.get("ask") != "plan":
        json.dumps(_desk().answer(asked))


def _posts() -> Iterator[bytes]:
    head = f"Host: 127.0.0.1:{_PORT}\r\nOrigin: {_ORIGIN}\r\nContent-Type: application/json\r\n"
    head += f"Authorization: Bearer {_TOKEN}"
    bodies = {"ask": [*_questions()], "order": [b'{"do":"fail","what":"pe:tail_pe"}', b'{"do":"kill","what":"x"}']}
    for path, sent in bodies.items():
        for body in sent:
            yield f"POST /api/{path}\r\n{head}\r\n\r\n".encode() + body


def _gets() -> Iterator[bytes]:
    paths = ("/", "/page/main.js", "/api/facts", "/api/graph?function=elevator", "/api/snapshot?at_ns=900000000")
    values = "/api/values?variable=altitude&from_ns=1&to_ns=900000000&points=9"
    for path in (*paths, values, "/api/events.jsonl", "/api/flight.log", "/api/snapshot?at_ns=1e400"):
        yield f"GET {path}\r\nHost: 127.0.0.1:{_PORT}".encode()


def _questions() -> Iterator[bytes]:
    yield b'{"ask":"why","function":"elevator","down":["device:gps"],"phase":null}'
    yield b'{"ask":"why","function":"parachute","down":["pe:tail_pe"]}'
    modules = {"gps_driver": {"pe": "sensor_pe", "mode": "only", "inputs": {}}}
    yield json.dumps({"ask": "script", "script": "Guav.PruneEdges ();", "modules": modules}).encode()


def _requests() -> Iterator[bytes]:
    yield from _gets()
    yield from _posts()


PAGES = (Target("question", _question, _questions), Target("request", _request, _requests))
