"""A recorded flight as the views show it: frames, events, and the snapshot at any time."""

from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_manager.events import Event
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Source
from heronry_tools.watch.timeline import Timeline
from heronry_wire.frame import LoggedFrame


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded flight: its frames, if there are any, and its feed."""

    spec: Spec
    frames: list[LoggedFrame]
    events: list[Event]
    source: Source

    def timeline(self) -> Timeline:
        """Return the timeline, which has the snapshot at any time."""
        return Timeline(Reducer(self.spec), self.events, self.source)
