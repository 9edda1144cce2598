"""Events of `heronry demo`: what it did to the system, and what it heard of its functions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from heronry_manager.events.event import Event
from heronry_manager.events.pes import Waited


@dataclass(frozen=True, slots=True)
class PlannedAhead(Event):
    """The demo makes plans for single faults while it flies; the next demo uses them."""

    sentence: str


@dataclass(frozen=True, slots=True)
class Page(Event):
    """Where a browser on this computer finds the page of the demo."""

    address: str


@dataclass(frozen=True, slots=True)
class Orders(Event):
    """With these flags the operator's commands reach the manager of the demo."""

    flags: str


@dataclass(frozen=True, slots=True)
class Process(Event):
    """What the demo did to a PE's process, or to that of a manager."""

    pe: Annotated[str, "'manager': the active one"]
    pid: int
    what: Literal["started", "killed", "restored"]


@dataclass(frozen=True, slots=True)
class Heartbeat(Event):
    """The heartbeat period that the demo flies with, and why: how late processes run here, or what the user gave."""

    late_ns: Annotated[int, "0 where the period was given"]
    period_ns: int
    of_spec_ns: int
    why: Literal["rehearsal", "rehearsal with a page", "given"] = "rehearsal"


@dataclass(frozen=True, slots=True)
class Logs(Event):
    """Where the demo's processes write their logs, and whether they stay there."""

    folder: str
    kept: bool


@dataclass(frozen=True, slots=True)
class Outage(Event):
    """The outputs of this function were not heard on the bus."""

    function: str
    from_ns: int
    to_ns: Annotated[int | None, "null: not back yet"]
    gathered: Annotated[bool, "true: `outages` sums this outage up"]


@dataclass(frozen=True, slots=True)
class Outages(Event):
    """A summary of the gathered `outage` events just before."""

    functions: tuple[str, ...]
    times: Annotated[int, "how many outages"]
    over: Annotated[bool, "false: not back yet"]
    shortest_ns: int
    longest_ns: int


@dataclass(frozen=True, slots=True)
class Overtime(Event):
    """The time of the demo is up, but it still awaits these effects."""

    awaited: tuple[str, ...]
    at_most_s: float


@dataclass(frozen=True, slots=True)
class Summary(Event):
    """The end of the demo: what the plan serves, and what was heard of it."""

    served: tuple[str, ...]
    unserved: Annotated[tuple[str, ...], "planned, but not heard on the bus"]
    never: Annotated[tuple[str, ...], "of these, those never heard at all"]
    waited: Annotated[Mapping[str, Waited], "for each of these, which process waited longest for a processor"]
    rivals: Annotated[tuple[str, ...], "branches of one DEMUX that drove alternately"]
    pending: Annotated[str | None, "what the manager had not finished; null: nothing"]
