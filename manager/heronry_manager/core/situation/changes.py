"""What follows from a change of the situation, as values that `intake` carries out, in their order.

HealthChange      a PE is no longer available: a fault was latched on it, or its radio is gone
PlanNeeded        the running plan was made for another situation
PlanInTime        the operator retires an element that still works: there is time for the best plan
LimitChanged      a radio has another limit: the running plan may still be the best one
PeSuspected       a module suspects a PE: the manager sends this PE a PING
TargetOrdered     the operator orders the configuration that a script makes, the target
TargetReleased    the operator ends a script
ModuleReleased    a module that its PE had stopped was cleared: only a new epoch starts it
"""

from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_manager.core.membership import HealthChange


@dataclass(frozen=True, slots=True)
class PlanNeeded:
    """A plan is needed, because the situation has changed.

    cause: why a plan is needed, in words.
    since_ns: when the old situation was last known to hold, such as the time of the last frame of a lost PE; None: now.
    """

    cause: str
    since_ns: int | None = None


@dataclass(frozen=True, slots=True)
class PlanInTime:
    """A plan is needed, but what runs may run on until the best one has come; `cause` says why, in words."""

    cause: str


@dataclass(frozen=True, slots=True)
class LimitChanged:
    """The usable bandwidth of a radio has changed; `cause` says how, in words."""

    cause: str


@dataclass(frozen=True, slots=True)
class ModuleReleased:
    """A fault of a module was cleared; the module starts again only with a new epoch.

    pe: the only PE on which the fault was cleared; None: it was cleared on all PEs.
    """

    module: str
    pe: str | None = None


@dataclass(frozen=True, slots=True)
class PeSuspected:
    """A module suspects this PE: the manager must ask the PE for its state, by PING."""

    pe: str


@dataclass(frozen=True, slots=True)
class TargetOrdered:
    """The operator has ordered, by a script, that the PEs run the configuration `target`, which is legal."""

    target: Configuration


@dataclass(frozen=True, slots=True)
class TargetReleased:
    """The operator has ended the script that was held, or that was ordered and not held yet."""


SituationChange = (
    PeSuspected
    | HealthChange
    | PlanNeeded
    | PlanInTime
    | LimitChanged
    | ModuleReleased
    | TargetOrdered
    | TargetReleased
)
Changes = Sequence[SituationChange]
