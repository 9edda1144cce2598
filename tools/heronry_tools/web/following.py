"""Reads a live feed in a thread, for the loop that owns the state of the pages.

    waiting ──a manager listens──► reading ──it has gone──► waiting for it, or for its standby manager

Heard is what comes from outside: an event of the manager, a frame. What a feed says by the clock alone (`heard`,
`bus_seen`) is shown, and is no sign of life. Where no bus is heard beside a manager, its open line counts, since a calm
flight has no events for minutes.
"""

import asyncio
import select
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from heronry_manager.shell.control_place import ControlError
from heronry_tools.console.errors import as_user_error
from heronry_tools.watch.live_feeds import Event, Feed, FollowedManager
from heronry_tools.web.live import Live

_LOOK_S: Final = 0.2
_AGAIN_S: Final = 0.3
_MOST_WAITING: Final = 64  # polls that the loop has not taken yet

OpenFeed = Callable[[], Feed]


def standby_of(path: Path) -> Path:
    """Give the socket of the standby manager beside that of a manager."""
    return path.with_name(f"{path.stem}-standby{path.suffix}")


def read_in_thread(open_feed: OpenFeed, live: Live, manager: Path | None) -> None:
    """Start to read, and give the running loop all that comes. manager: whose standby manager is followed after it."""
    loop = asyncio.get_running_loop()
    threading.Thread(target=_read, args=(open_feed, live, manager, loop), daemon=True, name="feed").start()


def _read(open_feed: OpenFeed, live: Live, manager: Path | None, loop: asyncio.AbstractEventLoop) -> None:
    room = threading.Semaphore(_MOST_WAITING)

    def take(events: Sequence[Event], trouble: str | None, is_alive: bool) -> None:
        room.release()
        live.take_all(events, trouble, is_alive=is_alive)

    try:
        feed, has_frames = _opened(open_feed, lambda why: loop.call_soon_threadsafe(live.waits, why)), False
        while True:
            select.select(feed.readers(), [], [], _LOOK_S)
            events = feed.poll()
            has_frames = has_frames or bool(feed.frames)
            is_alive = bool(feed.frames) if has_frames else feed.trouble is None
            room.acquire()
            loop.call_soon_threadsafe(take, events, feed.trouble, is_alive)
            if feed.trouble is not None and manager is not None:
                feed = _standby(feed, manager)
    except Exception as error:  # noqa: BLE001 - a thread that dies would leave pages that look alive
        sentence = as_user_error(error) or f"the feed has failed ({type(error).__name__}: {error})"
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(live.waits, sentence)


def _opened(open_feed: OpenFeed, waits: Callable[[str], object]) -> Feed:
    """Open a feed, once its manager listens; `waits` is told why it cannot be opened yet."""
    while True:
        try:
            return open_feed()
        except ControlError:
            waits("the manager does not listen yet")
        time.sleep(_AGAIN_S)


def _standby(feed: Feed, manager: Path) -> Feed:
    """Give the feed of the manager that listens now; the same feed where none does."""
    for path in (standby_of(manager), manager):
        with suppress(ControlError):
            other = FollowedManager(path)
            feed.close()
            return other
    return feed
