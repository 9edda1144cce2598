"""Events of a manager about itself: its start, its mastership, its journal, its bus, its end."""

from dataclasses import dataclass
from typing import Annotated

from heronry_manager.events.event import Event


@dataclass(frozen=True, slots=True)
class ManagerStarted(Event):
    """The manager has started, and listens first."""

    spec: str
    spec_digest: str
    node: int
    term: int
    bus: str
    phase: str | None
    advises: bool
    key: Annotated[str | None, "fingerprint"]


@dataclass(frozen=True, slots=True)
class SecondManager(Event):
    """Another manager sends LEASE, and this one ends."""

    node: int
    term: int


@dataclass(frozen=True, slots=True)
class StandingBy(Event):
    """Another manager is active; this one follows it, and can take over."""

    node: int
    term: int


@dataclass(frozen=True, slots=True)
class OtherSpecFlies(Event):
    """The active manager announces that another spec flies than this standby manager's, which does not take over."""

    digest: Annotated[str, "its first four digits"]


@dataclass(frozen=True, slots=True)
class Refused(Event):
    """Most PEs report that they hear no LEASE, though it is sent; the manager begins a new term."""

    term: int


@dataclass(frozen=True, slots=True)
class HearsNobody(Event):
    """No PE is heard any more; the manager is silent until it hears one, then begins a new term."""

    term: int


@dataclass(frozen=True, slots=True)
class SteppedDown(Event):
    """Another manager is active with a higher term; this one stands by from now on."""

    node: int
    term: int


@dataclass(frozen=True, slots=True)
class TakenOver(Event):
    """The PEs hear the previous manager no more; this one is active now."""

    term: int
    before: Annotated[int, "term of the previous manager"]
    silent_ns: Annotated[int | None, "null: no manager was heard"]
    phase: str | None


@dataclass(frozen=True, slots=True)
class Stopped(Event):
    """The manager ends."""

    reason: str


@dataclass(frozen=True, slots=True)
class JournalFailed(Event):
    """The journal cannot be written; what is not in it is lost at a restart."""

    problem: str


@dataclass(frozen=True, slots=True)
class JournalKept(Event):
    """The disk keeps the whole journal again."""

    before: Annotated[str | None, "the problem until now"]


@dataclass(frozen=True, slots=True)
class Bus(Event):
    """Which bus this is, and what it does not model."""

    name: str
    interface: str
    channel: str
    models: str


@dataclass(frozen=True, slots=True)
class BusTrouble(Event):
    """The manager's bus is lost, back, or full of errors."""

    sentence: str
