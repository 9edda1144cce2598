"""Reads a live feed in a thread, for the event loop that owns the state of the pages.

    waiting ──a manager listens──► reading ──this manager has gone──► waiting for this or its standby manager

Pages show how long nothing has come from the system. Only what comes from outside counts for that: an event of the
manager, or a frame. Observations that a feed makes by the clock (`heard`, `bus_seen`) do not count. If a manager is
followed without its bus, its open connection counts, too, since a calm flight has no events for minutes.
"""

import asyncio
import select
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from heronry_dg.model import Spec
from heronry_manager.events import Event
from heronry_manager.shell.control_place import ControlError, standby_of
from heronry_tools.console.errors import as_user_error
from heronry_tools.watch.live_feeds import Feed, FollowedManager
from heronry_tools.web.live import Live
from heronry_wire.frame import LoggedFrame

_LOOK_S: Final = 0.2
_AGAIN_S: Final = 0.3
_BETWEEN_S: Final = 0.01  # from one look to the next: a look costs more than the frame that it finds
_MOST_WAITING: Final = 64  # polls that the loop has not taken yet

OpenFeed = Callable[[], Feed]
Changed = Callable[[Spec, Path | None], None]
"""Is called in the event loop when the feed has another spec, with its file if the feed knows it."""


def read_in_thread(
    open_feed: OpenFeed, live: Live, manager: Path | None, changed: Changed = lambda _spec, _file: None
) -> None:
    """Start a thread that reads the feed and hands all events to `live`, in the running event loop.

    manager: the socket of the manager. If the feed has lost its manager, a feed of the standby manager takes its place.
    None: the feed is kept, and no standby manager is followed.
    changed: shows another spec from then on.
    """
    loop = asyncio.get_running_loop()
    threading.Thread(target=_read, args=(open_feed, live, manager, changed, loop), daemon=True, name="feed").start()


def _read(
    open_feed: OpenFeed, live: Live, manager: Path | None, changed: Changed, loop: asyncio.AbstractEventLoop
) -> None:
    room = threading.Semaphore(_MOST_WAITING)

    def take(events: Sequence[Event], plotted: Sequence[LoggedFrame], trouble: str | None, is_alive: bool) -> None:
        room.release()
        live.take_all(events, trouble, is_alive=is_alive)
        live.plots.take(plotted)

    feed, has_frames, digest = None, False, live.snapshot.spec_digest
    try:
        feed = _opened(open_feed, lambda why: loop.call_soon_threadsafe(live.waits, why))
        while True:
            select.select(feed.readers(), [], [], _LOOK_S)
            looked_s = time.monotonic()
            events = feed.poll()
            has_frames = has_frames or bool(feed.frames)
            is_alive = bool(feed.frames) if has_frames else feed.trouble is None
            if feed.spec.digest != digest:
                digest = feed.spec.digest
                loop.call_soon_threadsafe(changed, feed.spec, feed.spec_file)
            room.acquire()
            loop.call_soon_threadsafe(take, events, live.plots.picked(feed.frames), feed.trouble, is_alive)
            if feed.trouble is not None and manager is not None:
                feed = _standby(feed, manager)
            time.sleep(max(0.0, looked_s + _BETWEEN_S - time.monotonic()))
    except Exception as error:  # noqa: BLE001 - a thread that dies would leave pages that look alive
        sentence = as_user_error(error) or f"the feed has failed ({type(error).__name__}: {error})"
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(live.waits, sentence)
    finally:
        if feed is not None:
            feed.close()


def _opened(open_feed: OpenFeed, waits: Callable[[str], object]) -> Feed:
    """Open a feed; try again until its manager listens.

    waits: called after each failed try with a sentence which says that the manager does not listen yet.
    """
    while True:
        try:
            return open_feed()
        except ControlError:
            waits("the manager does not listen yet")
        time.sleep(_AGAIN_S)


def _standby(feed: Feed, manager: Path) -> Feed:
    """Follow the standby manager, or the manager at the path `manager` if the standby manager does not listen.

    Closes `feed`, and returns the new feed. If neither manager listens, returns `feed`, which stays open.
    """
    for path in (standby_of(manager), manager):
        with suppress(ControlError):
            other = FollowedManager(path)
            feed.close()
            return other
    return feed
