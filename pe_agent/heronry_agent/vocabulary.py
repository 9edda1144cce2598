"""What the agent core is told and what it asks for, beside frames and time (`heronry_wire.sansio`).

Every StepModule is answered by one `Stepped` or `StepFailed` that repeats its `release`, a number that is used once: an
answer that comes after the module was stopped is thereby recognised and dropped. A StartModule is answered only when it
failed. Nothing else needs an answer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from heronry_agent.module import Datum, Value
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import Received, Send, Tick, Withdraw

"""A deadline that does not come."""


class Stepped(NamedTuple):
    """A module has computed one period.

    outputs: value by variable; one left out is not published.
    writes: (device, value) in the order in which the module drove them.
    reports: (element, detail): elements that the module says have failed, as `device:NAME` or `module:NAME`.
    phases: mission phases that the module asked for, in their order.
    """

    module: int
    release: int
    outputs: Mapping[str, Value]
    writes: tuple[tuple[str, Value], ...] = ()
    reports: tuple[tuple[str, int], ...] = ()
    phases: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StepFailed:
    """A module raised an exception in its step; `reason` is one line."""

    module: int
    release: int
    reason: str


@dataclass(frozen=True, slots=True)
class StartFailed:
    """A module could not be built; `reason` is one line."""

    module: int
    reason: str


@dataclass(frozen=True, slots=True)
class StartModule:
    """Build a module anew, to run in a mode (an index into `entry.modes`)."""

    module: int
    entry: ModuleEntry
    mode: int


@dataclass(frozen=True, slots=True)
class StopModule:
    """Drop a module; it is stepped no more."""

    module: int


class StepModule(NamedTuple):
    """Let a module compute one period; `inputs` holds (variable, datum) by leaf path, fresh ones only."""

    module: int
    release: int
    inputs: Mapping[str, tuple[str, Datum]]


@dataclass(frozen=True, slots=True)
class Heard:
    """Another PE has said what it told one of its actuators: a simulated world follows it."""

    device: str
    value: float


@dataclass(frozen=True, slots=True)
class Note:
    """Something worth a line in the log; `kind` is a word to filter by."""

    kind: str
    text: str


class Left(NamedTuple):
    """A frame has left the controller of a port, `took_ns` after it was handed over; 0: nobody knows."""

    port: int
    took_ns: int


Event = Received | Tick | Stepped | StepFailed | StartFailed | Left
Action = Send | Withdraw | StartModule | StopModule | StepModule | Heard | Note
