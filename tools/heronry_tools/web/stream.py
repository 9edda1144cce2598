"""The one stream of a page, as server-sent events.

    event: whole     sent first: the snapshot, the loads of the last minutes, and for a recording its begin and end
                     (`offered`: the orders that the page may give now). Sent again, as the last event, if the aircraft
                     changes to another spec: the page must begin anew
    event: change    what differs from the snapshot that was sent before (`changes`)
    event: beat      sent at least once a second. For a live feed: for how long nothing has come, and why; for a
                     recording: the time that is shown, and whether the recording plays

For a live feed, a change is sent at least `_BETWEEN_FIGURES_S` after the change before, or `_BETWEEN_LINES_S` after it
if the change adds an event to the snapshot's list of events. The reason for these pauses: on a busy computer, every
change that the browser draws delays the next one. If a page gets no beat any more, it knows that the server itself is
gone.
"""

import asyncio
import json
import time
from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import aclosing
from typing import Any, Final

from heronry_tools.watch.offered_orders import OfferedOrders
from heronry_tools.watch.reducer import State
from heronry_tools.watch.snapshot import Snapshot, document
from heronry_tools.web.changes import change
from heronry_tools.web.live import Live
from heronry_tools.web.plots.live import live_values
from heronry_tools.web.recording import Recording

_BEAT_S: Final = 1.0
_BETWEEN_FIGURES_S: Final = 0.25
_BETWEEN_LINES_S: Final = 0.02
_BETWEEN_STEPS_S: Final = 0.1  # of a recording that plays


def sent(kind: str, data: Any) -> str:
    """Write one server-sent event."""
    return f"event: {kind}\ndata: {json.dumps(data, separators=(',', ':'))}\n\n"


def _whole(snapshot: Snapshot, loads: list[dict[str, Any]], **more: Any) -> str:
    return sent("whole", {"snapshot": document(snapshot), "loads": loads, **more})


def _changed(before: Snapshot, after: Snapshot, loads: list[dict[str, Any]], **more: Any) -> str:
    return sent("change", {**change(before, after), "loads": loads, **more})


async def live_stream(live: Live, closing: asyncio.Event, offers: OfferedOrders | None = None) -> AsyncIterator[str]:
    """Stream the present state of a system, until `closing` is set or the aircraft changes to another spec.

    offers: the orders that the page may give; they are sent as `offered`, by element, whenever they have changed.
    """
    known = live.snapshot
    offered = None if offers is None else offers.now(known)
    yield _whole(known, live.loads(0), offered=offered or {})
    yield _live_beat(live)
    beat_s, told, sent_s = time.monotonic(), live.trouble, 0.0
    while not closing.is_set():
        now, due_s = live.snapshot, beat_s + _BEAT_S
        if now.spec_digest != known.spec_digest:
            yield _whole(now, live.loads(0), offered={})
            return
        if now is not known:  # perhaps since before the last change was sent: nothing else may come that would wake
            between_s = _BETWEEN_FIGURES_S if now.told is known.told else _BETWEEN_LINES_S
            due_s = min(due_s, sent_s + between_s)
        if (rest_s := due_s - time.monotonic()) > 0 and live.trouble == told:
            await live.changed(rest_s)
        elif now is not known:
            before, offered = offered, None if offers is None else offers.now(now)
            yield _changed(known, now, live.loads(known.events), **({} if offered == before else {"offered": offered}))
            known, sent_s = now, time.monotonic()
        if time.monotonic() - beat_s >= _BEAT_S or live.trouble != told:
            beat_s, told = time.monotonic(), live.trouble
            yield _live_beat(live)


async def values_stream(live: Live, variables: Sequence[str], closing: asyncio.Event) -> AsyncGenerator[str]:
    """Stream the samples of these variables, until `closing` is set (`plots.live`)."""
    async with aclosing(live_values(live.plots, variables, lambda: live.snapshot, closing)) as told:
        async for kind, data in told:
            yield sent(kind, data)


def _live_beat(live: Live) -> str:
    return sent("beat", {"age_s": round(live.age_s(), 1), "trouble": live.trouble})


async def recorded_stream(
    recording: Recording, from_ns: int, speed: float, closing: asyncio.Event
) -> AsyncIterator[str]:
    """Stream a recording from the time `from_ns` on, until `closing` is set.

    speed: how many times faster than the flight; 0: only the state at `from_ns` is shown.
    """
    begun_s, events = time.monotonic(), recording.events_until(from_ns)
    state: State = recording.after(events)
    span = {"first_ns": recording.begins_ns, "last_ns": recording.ends_ns, "marks": recording.marks}
    yield _whole(state.snapshot, recording.loads(0, events), recording=span, at_ns=from_ns)
    while not closing.is_set():
        at_ns = min(from_ns + round((time.monotonic() - begun_s) * speed * 1e9), recording.ends_ns)
        now = recording.events_until(at_ns) if speed else events
        if now > events:
            later = recording.after(now, state)
            yield _changed(state.snapshot, later.snapshot, recording.loads(events, now))
            state, events = later, now
        plays = speed > 0 and at_ns < recording.ends_ns
        yield sent("beat", {"age_s": 0, "trouble": None, "at_ns": at_ns, "plays": plays})
        await asyncio.sleep(_BETWEEN_STEPS_S if plays else _BEAT_S)
