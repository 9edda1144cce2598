"""Events about plans and epochs: what is planned and why, how it is deployed, and what runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from heronry_dg.plan_document import PlanDocument
from heronry_manager.events.event import Event


@dataclass(frozen=True, slots=True)
class Times:
    """The duration of a reconfiguration, in four parts, in ns; null: not known."""

    detect: int | None
    decide: int | None
    distribute: int | None
    activate: int | None

    def by_name(self) -> dict[str, int | None]:
        """Return the parts by their names, in order of time."""
        parts = {"detect": self.detect, "decide": self.decide, "distribute": self.distribute}
        return parts | {"activate": self.activate}


@dataclass(frozen=True, slots=True)
class PlanRequested(Event):
    """The planner is asked for a plan for this situation."""

    request: int
    down: tuple[str, ...]
    limits: Annotated[Mapping[str, str], "percentages by element"]
    phase: str | None
    causes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PlanReady(Event):
    """The planner has answered."""

    request: int
    plan: Annotated[PlanDocument, "as 'heronry plan --json' prints it"]
    decide_ns: int


@dataclass(frozen=True, slots=True)
class PlanFailed(Event):
    """The planner could not answer; the present configuration goes on."""

    request: int
    reason: str


@dataclass(frozen=True, slots=True)
class PlanUnchanged(Event):
    """The new plan is what runs already."""

    request: int


@dataclass(frozen=True, slots=True)
class PlanKept(Event):
    """The optimal plan is not better at levels 1 to 3, so the running configuration stays."""

    request: int


@dataclass(frozen=True, slots=True)
class EpochPrepared(Event):
    """PREPARE and slices are sent."""

    epoch: int
    digest: str
    contingency: Annotated[int, "its number; 0: none"]
    pes: tuple[str, ...]
    bytes: Annotated[int, "of all slices"]


@dataclass(frozen=True, slots=True)
class EpochAbandoned(Event):
    """The epoch was given up before ACTIVATE."""

    epoch: int
    reason: str


@dataclass(frozen=True, slots=True)
class EpochStep(Event):
    """ACTIVATE with this step was sent."""

    epoch: int
    step: str
    waiting_for: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PeRefused(Event):
    """A PE cannot stage its slice."""

    pe: str
    epoch: int
    reason: str


@dataclass(frozen=True, slots=True)
class AnotherTable(Event):
    """The PE stages nothing, since its table is not the one that this manager compiles for it."""

    pe: str
    why: str


@dataclass(frozen=True, slots=True)
class TableBrought(Event):
    """The PE waited without a table, and has taken the one that this manager brought it over the bus."""

    pe: str
    bytes: int
    took_ns: int


@dataclass(frozen=True, slots=True)
class TableNotTaken(Event):
    """The PE waits without a table, and did not take the one that this manager brought; it is brought again."""

    pe: str
    why: str


@dataclass(frozen=True, slots=True)
class UnknownNode(Event):
    """A node uses a node-ID of a PE that the spec does not have."""

    node: int
    says: Annotated[str, "what it does: whether it waits for a table, runs nothing, or runs for another system"]


@dataclass(frozen=True, slots=True)
class CodeBrought(Event):
    """The PE lacked code, and runs this version of the bundle that this manager brought it over the bus."""

    pe: str
    bundle: str
    version: int
    bytes: int
    took_ns: int


@dataclass(frozen=True, slots=True)
class CodeNotTaken(Event):
    """The PE lacks code, and did not take the bundle that this manager has for it; its sentence says why."""

    pe: str
    why: str


@dataclass(frozen=True, slots=True)
class Reconfigured(Event):
    """This epoch runs now."""

    epoch: int
    causes: tuple[str, ...]
    times_ns: Times
    moved: tuple[str, ...]
    started: tuple[str, ...]
    stopped: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Adopted(Event):
    """The PEs run a known configuration already; this mastership takes it over as it is."""

    epoch: int
    digest: str


@dataclass(frozen=True, slots=True)
class Advice(Event):
    """What a manager that only advises would do."""

    plan: Annotated[PlanDocument, "as 'heronry plan --json' prints it"]
    moved: tuple[str, ...]
    started: tuple[str, ...]
    stopped: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class UnknownEpoch(Event):
    """The PEs run an epoch that this manager, which only advises, does not know."""

    epoch: int


@dataclass(frozen=True, slots=True)
class ControlPaths(Event):
    """Which control loops this epoch closes."""

    epoch: int
    plants: Annotated[
        Mapping[str, str],
        "by name: on_path, open, unmoved (no module drives its actuators) or unseen (none reads its sensors)",
    ]


@dataclass(frozen=True, slots=True)
class ScriptTaken(Event):
    """A script of the operator is accepted: its configuration is deployed, and held."""

    reason: str


@dataclass(frozen=True, slots=True)
class ScriptRefused(Event):
    """A script of the operator was refused; what runs stays."""

    reason: str


@dataclass(frozen=True, slots=True)
class ScriptEnded(Event):
    """The script that was held has ended."""

    reason: str
