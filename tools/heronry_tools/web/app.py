"""The web application: what is answered at each address.

Only requests that the guard (`guard`) has let in get here.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, Final, NoReturn, TypeVar

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from heronry_dg.model import Spec
from heronry_tools.watch.offered_orders import ORDERS, OfferedOrders
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.snapshot import document
from heronry_tools.web.facts import facts
from heronry_tools.web.guard import Access, Guard
from heronry_tools.web.live import Live
from heronry_tools.web.picture import picture
from heronry_tools.web.plots.asked import PlotError, checked_variables
from heronry_tools.web.plots.recorded import RecordedPlots
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording
from heronry_tools.web.stream import live_stream, recorded_stream, values_stream
from heronry_wire.frame import LoggedFrame, format_log_line

PAGE: Final = Path(__file__).parent / "page"
_MOST_BYTES: Final = 65_536  # of a question or an order
_LOOK_S: Final = 0.2
_FASTEST: Final = 64.0
_USUAL_POINTS: Final = 1_500
_NO_STORE: Final = {"cache-control": "no-store"}
_NOBODY_WAITS: Final = Response(status_code=499)

T = TypeVar("T")


class _Closing(StreamingResponse):
    """A stream of events that ends its generator at once when the page goes away, and not when it is collected."""

    def __init__(self, events: AsyncGenerator[str]) -> None:
        super().__init__(events, media_type="text/event-stream", headers=_NO_STORE)
        self._events = events

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the events until there are no more, or the page goes away."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            await self._events.aclose()


@dataclass(eq=False)
class Site:
    """All that the pages of one system show, and the handlers of their requests."""

    spec: Spec
    shown: Live | Recording
    questions: Questions
    orders: Orders
    access: Access
    frames: Sequence[LoggedFrame] = ()  # of a recorded flight
    pictures: dict[str, str] = field(default_factory=dict)  # by function; under the empty name: the whole graph
    closing: asyncio.Event = field(default_factory=asyncio.Event)
    drawing: Lock = field(default_factory=Lock)

    @cached_property
    def _kinds(self) -> list[str]:
        """The kinds of orders that pages may give."""
        return self.orders.kinds() if self.access.operates else []

    @cached_property
    def _offers(self) -> OfferedOrders | None:
        return OfferedOrders(self.spec, self._kinds) if self._kinds else None

    @cached_property
    def facts(self) -> dict[str, Any]:
        """Return what a page gets once, when it is opened: the spec's facts, and what this server can do."""
        return {
            **facts(self.spec),
            "recorded": isinstance(self.shown, Recording),
            "orders": {order: asdict(ORDERS[order]) for order in self._kinds},
            "retired": {} if self._offers is None else dict(self._offers.parts),
            "has_frames": bool(self.frames),
        }

    @cached_property
    def _recorded_plots(self) -> RecordedPlots:
        assert isinstance(self.shown, Recording)
        return RecordedPlots(self.shown.reducer, self.shown.events, self.frames)

    def change_to(self, spec: Spec, file: Path | None) -> None:
        """Go on with another spec, to which the aircraft has changed; `file`: its file. Each page begins anew."""
        assert isinstance(self.shown, Live)
        self.spec = spec
        self.pictures = {}
        for name in ("facts", "_offers"):
            self.__dict__.pop(name, None)
        if file is not None:
            self.questions.change_to(spec, file)
        self.shown.change_to(spec)

    def picture(self, function: str) -> str:
        """Return the drawing of what contributes to a function, or of the whole graph if `function` is empty.

        Each drawing is made only once.
        """
        with self.drawing:
            pictures = self.pictures
            if function not in pictures:
                pictures[function] = picture(self.spec, function or None)
            return pictures[function]

    async def page(self, _: Request) -> Response:
        """Answer with the page itself, the file `index.html`."""
        return FileResponse(PAGE / "index.html", headers={"cache-control": "no-cache"})

    async def tell_facts(self, _: Request) -> Response:
        """Answer with the facts that a page gets once, when it is opened (`facts`)."""
        return JSONResponse(self.facts, headers=_NO_STORE)

    async def draw(self, request: Request) -> Response:
        """Answer with a drawing (SVG) of the graph, or of the part that contributes to the `function` of the query."""
        function = request.query_params.get("function", "")
        if function and function not in self.spec.functions:
            return _refused(404, f"the spec has no function '{function}'")
        drawing = await asyncio.to_thread(self.picture, function)
        return Response(drawing, media_type="image/svg+xml", headers=_NO_STORE)

    async def snapshot(self, request: Request) -> Response:
        """Answer with one snapshot as JSON.

        This is the present snapshot, or in a recording the one at the time `at_ns` of the request (default: the end).
        """
        if isinstance(self.shown, Live):
            return JSONResponse(document(self.shown.snapshot), headers=_NO_STORE)
        at_ns = _number(request, "at_ns", self.shown.ends_ns)
        state = self.shown.after(self.shown.events_until(round(at_ns)))
        return JSONResponse(document(state.snapshot), headers=_NO_STORE)

    async def stream(self, request: Request) -> Response:
        """Answer with the stream of server-sent events for one page (`stream`).

        It shows the present state of a system as it changes, or a recording as it plays.
        """
        if isinstance(self.shown, Live):
            lines = live_stream(self.shown, self.closing, self._offers)
        else:
            from_ns = round(_number(request, "at_ns", self.shown.first_configuration_ns))
            speed = min(max(_number(request, "speed", 0.0), 0.0), _FASTEST)
            lines = recorded_stream(self.shown, from_ns, speed, self.closing)
        return StreamingResponse(lines, media_type="text/event-stream", headers=_NO_STORE)

    async def values(self, request: Request) -> Response:
        """Answer with the samples of the variables that the query names (`plots`).

        Of a live system this is a stream of server-sent events, without an end. Of a recording it is one JSON object,
        with the samples from `from_ns` to `to_ns` (default: all), and at most `points` in a series (at least 3).
        A request that cannot be answered is refused with status 400.
        """
        try:
            variables = checked_variables(self.spec, request.query_params.getlist("variable"))
            if isinstance(self.shown, Live):
                self.shown.plots.expect_room(variables)
                return _Closing(values_stream(self.shown, variables, self.closing))
            from_ns = round(_number(request, "from_ns", self.shown.begins_ns))
            to_ns = round(_number(request, "to_ns", self.shown.ends_ns))
            points = round(_number(request, "points", _USUAL_POINTS))
            told = await asyncio.to_thread(self._recorded_plots.told, variables, from_ns, to_ns, max(3, points))
        except PlotError as error:
            return _refused(400, str(error))
        return JSONResponse(told, headers=_NO_STORE)

    async def events(self, _: Request) -> Response:
        """Answer with a file of JSON lines: the events of the system or the recording that is shown."""
        name = f"{self.spec.name}.events.jsonl"
        text = "".join(f"{line}\n" for line in self.shown.lines())
        head = {**_NO_STORE, "content-disposition": f'attachment; filename="{name}"'}
        return Response(text, media_type="application/jsonl", headers=head)

    async def candump(self, _: Request) -> Response:
        """Answer with the recorded frames as a candump log; refuse with status 404 if no frames are recorded."""
        if not self.frames:
            return _refused(404, "no frames are recorded here: use 'heronry record' or 'heronry demo --record'")
        lines = (f"{format_log_line(frame)}\n" for frame in self.frames)
        head = {**_NO_STORE, "content-disposition": f'attachment; filename="{self.spec.name}.log"'}
        return StreamingResponse(lines, media_type="text/plain", headers=head)

    async def ask(self, request: Request) -> Response:
        """Pass a question on to the planner's process, and answer with what this process answers.

        A body that is no JSON object is refused with status 400.

        If the page closes the request before the answer has come, or the server ends, the planner's search is ended.
        """
        question = await _json(request)
        if question is None:
            return _refused(400, "the body of a question must be a JSON object")
        answer = await self._awaited(request, self.questions.ask(question))
        return _NOBODY_WAITS if answer is None else JSONResponse(answer, headers=_NO_STORE)

    async def _awaited(self, request: Request, working: Coroutine[Any, Any, T]) -> T | None:
        """Wait for an answer; returns None, and ends the work, if the page is closed or the server ends."""
        waiting = asyncio.create_task(working)
        while not (await asyncio.wait({waiting}, timeout=_LOOK_S))[0]:
            if self.closing.is_set() or await request.is_disconnected():
                waiting.cancel()
                return None
        return waiting.result()

    async def warm(self, _: Request) -> Response:
        """Start the planner's process in advance, so that it is ready when the page asks a question."""
        await self.questions.warm()
        return JSONResponse({"done": True}, headers=_NO_STORE)

    async def order(self, request: Request) -> Response:
        """Send an order to the manager or the demo, and answer with the result."""
        answer = await self._awaited(request, asyncio.to_thread(self.orders.give, await _json(request)))
        if answer is None:
            return _NOBODY_WAITS
        return JSONResponse({"done": answer.done, "sentence": answer.sentence}, headers=_NO_STORE)


def application(site: Site, begun: Callable[[], None] = lambda: None) -> Guard:
    """Make the application, behind its guard; `begun` is called in the event loop when the application starts."""

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        begun()
        yield
        site.closing.set()
        await site.questions.close()

    routes = [
        Route("/", site.page),
        Mount("/page", StaticFiles(directory=PAGE)),
        Route("/api/facts", site.tell_facts),
        Route("/api/graph", site.draw),
        Route("/api/snapshot", site.snapshot),
        Route("/api/stream", site.stream),
        Route("/api/values", site.values),
        Route("/api/events.jsonl", site.events),
        Route("/api/flight.log", site.candump),
        Route("/api/ask", site.ask, methods=["POST"]),
        Route("/api/warm", site.warm, methods=["POST"]),
        Route("/api/order", site.order, methods=["POST"]),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), site.access)


async def _json(request: Request) -> dict[str, Any] | None:
    """Read the JSON object of a question or an order; None if there is none, or if it is too long."""
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > _MOST_BYTES:
            return None
    try:
        read = json.loads(bytes(body), parse_constant=_refuse_constant)
        json.dumps(read, ensure_ascii=False).encode()  # half of a surrogate pair is no text that an answer could repeat
    except (ValueError, RecursionError):
        return None
    return read if isinstance(read, dict) else None


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON")


def _number(request: Request, name: str, usual: float) -> float:
    """Read the query parameter `name` of the address.

    Return `usual` if the parameter is missing, is no number, or is 1e30 or more in magnitude.
    """
    try:
        value = float(request.query_params.get(name, usual))
    except ValueError:
        return usual
    return value if abs(value) < 1e30 else usual


def _refused(code: int, sentence: str) -> Response:
    return JSONResponse({"done": False, "sentence": sentence}, status_code=code, headers=_NO_STORE)
