"""The samples of variables in a recording: all of its frames are there, so any span of time can be asked for.

The frames of a variable are read when it is plotted first. The samples of the last `_KEPT` variables are kept.
"""

from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from threading import Lock
from typing import Any, Final

from heronry_manager.events import Event
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.plots.asked import PlotError, Sources, Uses, refusals, uses
from heronry_tools.web.plots.tracks import Track
from heronry_wire.frame import LoggedFrame

MOST_POINTS: Final = 4_000  # of one series in an answer
_KEPT: Final = 16  # variables


class RecordedPlots:
    """The tracks of the variables of a recording. `told` may be called in several threads."""

    def __init__(self, reducer: Reducer, events: Sequence[Event], frames: Sequence[LoggedFrame]) -> None:
        self._reducer, self._events, self._frames = reducer, events, frames
        self._tracks: OrderedDict[str, list[Track]] = OrderedDict()  # by variable, the last one that was asked for last
        self._turn = Lock()

    @cached_property
    def _sources(self) -> Sources:
        return Sources(self._reducer.spec)

    @cached_property
    def _uses(self) -> list[tuple[int, dict[str, Uses]]]:
        """Who reads what, whenever another configuration begins to run, with the time in ns."""
        state = self._reducer.start()
        found = [(0, uses(state.snapshot))]
        for event in self._events:
            before, state = state, self._reducer.after(state, event)
            if state.running is not before.running:
                found.append((event.t_ns, uses(state.snapshot)))
        return found

    def told(self, variables: Sequence[str], from_ns: int, to_ns: int, most: int) -> dict[str, Any]:
        """Return the plots of some variables between two times, with at most `most` points in a series.

        Raises PlotError if the recording has no frames.
        """
        if not self._frames:
            raise PlotError(
                "this recording has events alone, and no frames: plot a log, or a folder of 'heronry record'"
            )
        with self._turn:
            tracks = {name: self._tracks_of(name) for name in variables}
            return {
                "plots": [self._sources.told(name) for name in variables],
                "series": {
                    name: [one for track in some for one in track.between(from_ns, to_ns, min(most, MOST_POINTS))]
                    for name, some in tracks.items()
                },
                "used": {name: self._used(name) for name in variables},
                "refused": {name: refusals(some) for name, some in tracks.items()},
            }

    def _tracks_of(self, variable: str) -> list[Track]:
        if variable not in self._tracks:
            tracks = {source.identifier: Track(source) for source in self._sources.of(variable)}
            for logged in self._frames:
                frame = logged.frame
                if frame.can_id in tracks and not frame.error:
                    tracks[frame.can_id].take(logged.time_ns, frame)
            self._tracks[variable] = list(tracks.values())
            if len(self._tracks) > _KEPT:
                self._tracks.popitem(last=False)
        self._tracks.move_to_end(variable)
        return self._tracks[variable]

    def _used(self, variable: str) -> list[list[Any]]:
        """Return the times at which other modules begin to read other sources of a variable, with who reads which."""
        found: list[list[Any]] = []
        for t_ns, read in self._uses:
            now = read.get(variable, {})
            if not found or found[-1][1] != now:
                found.append([t_ns, now])
        return found
