"""Events about PEs: whether they are heard, believed, and hold outputs back."""

from dataclasses import dataclass
from typing import Annotated

from heronry_manager.events.event import Event


@dataclass(frozen=True, slots=True)
class Waited:
    """Who waited for a processor, and for how long."""

    who: str
    for_ns: int
    of_ns: Annotated[int, "the length of the interval in which that was measured"]


@dataclass(frozen=True, slots=True)
class PeSuspected(Event):
    """A state frame is late; the manager sends the PE a PING."""

    pe: str
    cause: str
    silent_ns: Annotated[int | None, "null: never heard"]


@dataclass(frozen=True, slots=True)
class PeAnswered(Event):
    """A suspected PE is heard again in time."""

    pe: str


@dataclass(frozen=True, slots=True)
class PeLost(Event):
    """The PE is no longer available."""

    pe: str
    cause: str
    last_heard_ns: Annotated[int | None, "null: never heard"]
    waited: Annotated[
        Waited | None, "only in a demo that has not killed the PE: which process waited longest for a processor"
    ] = None


@dataclass(frozen=True, slots=True)
class PeAbsent(Event):
    """The PE was not heard in the start-up window."""

    pe: str
    cause: str


@dataclass(frozen=True, slots=True)
class PeHeardAgain(Event):
    """A PE that was lost is heard again; its hold-down begins."""

    pe: str
    cause: str


@dataclass(frozen=True, slots=True)
class PeJoined(Event):
    """The PE is available from now on."""

    pe: str
    cause: str


@dataclass(frozen=True, slots=True)
class StoodStill(Event):
    """The computer stood still for more than a period."""

    by: Annotated[str, "a PE, a manager, the demo"]
    for_ns: int
    times: Annotated[int, "so far"]


@dataclass(frozen=True, slots=True)
class CommandsRefused(Event):
    """How many commands a PE with a key has refused so far."""

    pe: str
    unproven: Annotated[int, "with a wrong tag"]
    other: int


@dataclass(frozen=True, slots=True)
class StatesUnproven(Event):
    """The PE is heard, but proves nothing when asked: another key, no key, or a failed receiver."""

    pe: str


@dataclass(frozen=True, slots=True)
class StatesDoubted(Event):
    """Many states of the PE had a wrong tag; from now on a state counts only if the one before it was proven, too."""

    pe: str
    refused: Annotated[int, "number of states so far"]


@dataclass(frozen=True, slots=True)
class Attacked(Event):
    """Forged frames take a tenth of the manager's bus or more."""

    bus: str
    percent: int
    frames_per_s: int


@dataclass(frozen=True, slots=True)
class OutputsHeld(Event):
    """A PE holds exclusive outputs back for longer than T_lease."""

    pe: str
    modules: tuple[str, ...]
    cause: str


@dataclass(frozen=True, slots=True)
class OutputsFree(Event):
    """The PE no longer holds exclusive outputs back; it held them back for this time."""

    pe: str
    for_ns: int
