"""Events that a feed has beside those of the manager and the demo; a feed is what a snapshot is made from.

status, runs, lines_lost    from the manager's driver, to a reader of its events (`follow`)
resumed                     begins a file of a recording
feed                        begins a feed
all other kinds             from the frames of a bus, live or recorded
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from heronry_dg.plan_document import PlanDocument
from heronry_manager.events.epochs import Times
from heronry_manager.events.event import Event


@dataclass(frozen=True, slots=True)
class Place:
    """The bus of a manager, as python-can names it."""

    name: str
    interface: str
    channel: str


@dataclass(frozen=True, slots=True)
class Status(Event):
    """Where a reader begins."""

    status: Annotated[Mapping[str, Any], "as 'heronry status --json' prints it"]
    plan: Annotated[PlanDocument | None, "null: it is not known what runs"]
    bus: Place
    file: Annotated[str, "the spec's"]


@dataclass(frozen=True, slots=True)
class Runs(Event):
    """The plan of an epoch that runs from now on."""

    epoch: int
    plan: PlanDocument


@dataclass(frozen=True, slots=True)
class LinesLost(Event):
    """Some lines were dropped, because this reader was too slow; a new status follows."""

    lines: Annotated[int, "how many"]


@dataclass(frozen=True, slots=True)
class Resumed(Event):
    """Everything so far, where older files of a recording may be gone."""

    snapshot: Annotated[Mapping[str, Any], "as 'heronry top --json' prints it"]
    plan: PlanDocument | None


@dataclass(frozen=True, slots=True)
class Feed(Event):
    """The first line of every feed."""

    source: Literal["manager", "bus", "log", "record", "simulator"]
    knows_why: Annotated[bool, "the manager's own events are in the feed"]
    spec: str
    spec_digest: str


@dataclass(frozen=True, slots=True)
class BusSeen(Event):
    """The traffic of the last second."""

    bus: str
    load: Annotated[float, "a share of the bit rate"]
    peak: Annotated[float, "in the busiest tenth"]
    bits_per_s: Annotated[Mapping[str, int], "by kind of traffic"]
    frames_per_s: int
    errors: Annotated[int, "so far"]
    error_state: str | None


@dataclass(frozen=True, slots=True)
class Heard(Event):
    """The time of the last frame of each, as far as it is new."""

    pes: Annotated[Mapping[str, int], "times in ns"]
    functions: Annotated[Mapping[str, tuple[int, bool]], "times in ns, and whether it is served"]


@dataclass(frozen=True, slots=True)
class PeSeen(Event):
    """A state frame says something new."""

    pe: str
    incarnation: int
    epoch: int | None
    runs: str | None
    hears_manager: bool | None
    load_percent: int | None


@dataclass(frozen=True, slots=True)
class ManagerSeen(Event):
    """LEASE names another manager or term."""

    node: int
    term: int


@dataclass(frozen=True, slots=True)
class EpochSeen(Event):
    """All PEs that are heard run this epoch."""

    epoch: int
    plan: Annotated[PlanDocument | None, "null: its configuration is not known"]
    began_ns: int
    times_ns: Times
