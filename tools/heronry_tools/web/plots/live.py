"""The samples of variables that pages plot now.

A page opens a plot with the address of its stream, and closes it with the connection. The first page that plots a
variable makes its tracks, and the last one drops them. Only while there is a track, the thread of the feed looks at the
frames that it has heard. A page that is slow gets the samples that are still kept.
"""

import asyncio
import time
from collections.abc import AsyncGenerator, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from heronry_dg.model import Spec
from heronry_tools.watch.snapshot import Snapshot
from heronry_tools.web.plots.asked import PlotError, Sources, Uses, refusals, uses
from heronry_tools.web.plots.tracks import Track
from heronry_wire.frame import LoggedFrame

KEPT_SAMPLES: Final = 6_000  # of each source: a minute of 100 Hz; up to twice as many before the oldest are dropped
MOST_TRACKS: Final = 256
_BETWEEN_S: Final = 0.25


@dataclass(slots=True)
class _Plotted:
    """A variable that at least one page plots."""

    tracks: list[Track]
    pages: int = 0


class LivePlots:
    """The tracks of all variables that are plotted.

    `picked` may be called in another thread than everything else.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._sources: Sources | None = None  # made with the first plot
        self._plotted: dict[str, _Plotted] = {}
        self._by_identifier: dict[int, Track] = {}  # replaced as a whole, never changed: the thread reads it

    @property
    def sources(self) -> Sources:
        """Return the sources of the spec."""
        if self._sources is None:
            self._sources = Sources(self._spec)
        return self._sources

    def picked(self, frames: Sequence[LoggedFrame]) -> tuple[LoggedFrame, ...]:
        """Return those of the frames that are samples of a plotted variable."""
        wanted = self._by_identifier
        return tuple(logged for logged in frames if logged.frame.can_id in wanted) if wanted else ()

    def take(self, frames: Sequence[LoggedFrame]) -> None:
        """Take picked frames; one of a plot that was closed meanwhile is dropped."""
        for logged in frames:
            track = self._by_identifier.get(logged.frame.can_id)
            if track is not None and not logged.frame.error:
                track.take(logged.time_ns, logged.frame)

    def expect_room(self, variables: Sequence[str]) -> None:
        """Raise PlotError if too much would be plotted at once, with these variables."""
        missing = sum(len(self.sources.of(name)) for name in variables if name not in self._plotted)
        if len(self._by_identifier) + missing > MOST_TRACKS:
            raise PlotError("too many variables are plotted at once: close a plot, here or in another window")

    @contextmanager
    def opened(self, variables: Sequence[str]) -> Iterator[dict[str, list[Track]]]:
        """Keep the tracks of these variables while the context is entered; yields them by variable."""
        for name in variables:
            if name not in self._plotted:
                self._plotted[name] = _Plotted([Track(source, KEPT_SAMPLES) for source in self.sources.of(name)])
            self._plotted[name].pages += 1
        self._note()
        try:
            yield {name: self._plotted[name].tracks for name in variables}
        finally:
            for name in variables:
                self._plotted[name].pages -= 1
                if not self._plotted[name].pages:
                    del self._plotted[name]
            self._note()

    def _note(self) -> None:
        plotted = self._plotted.values()
        self._by_identifier = {track.source.identifier: track for one in plotted for track in one.tracks}


async def live_values(
    plots: LivePlots,
    variables: Sequence[str],
    snapshot: Callable[[], Snapshot],
    closing: asyncio.Event,
) -> AsyncGenerator[tuple[str, Any]]:
    """Yield what a page with plots of these variables is told, until `closing` is set; the first time at once.

    ("plots", [...])     what is known of each variable; once
    ("samples", {...})   the samples since the last time, and by variable who uses it, where that has changed
    """
    with plots.opened(variables) as tracks:
        yield "plots", [plots.sources.told(name) for name in variables]
        counts = dict.fromkeys((track for some in tracks.values() for track in some), 0)
        used: dict[str, Uses] = {}
        seen_ns = 0
        while not closing.is_set():
            begun_s, now = time.monotonic(), snapshot()
            documents = {name: [one for track in tracks[name] for one in track.since(counts[track])] for name in tracks}
            counts = {track: track.count for track in counts}
            read = uses(now)
            found = {name: read.get(name, {}) for name in variables}
            since_ns = now.reconfigurations[-1].done_ns if now.reconfigurations else 0
            changed = {name: one for name, one in found.items() if used.get(name) != one}
            yield (
                "samples",
                {
                    "at_ns": now.t_ns,
                    "series": {name: [one for one in some if one["t_ns"]] for name, some in documents.items()},
                    "used": {name: [[max(seen_ns, since_ns), one]] for name, one in changed.items()},
                    "refused": {name: refusals(some) for name, some in tracks.items()},
                },
            )
            used, seen_ns = found, now.t_ns
            await asyncio.sleep(max(0.0, _BETWEEN_S - (time.monotonic() - begun_s)))
