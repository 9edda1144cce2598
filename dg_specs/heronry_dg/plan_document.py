"""A plan as people and programs read it: what `heronry plan --json` prints, and what events carry.

The fields of these data classes are the keys of the JSON object, in its order. A plan document is not checked against
a spec: it may come from a recording, so its names may be unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass

from heronry_dg.configuration import Configuration, Running
from heronry_dg.plan_report import BusReport, FunctionReport, LevelReport, PeReport

Json = dict[str, object]


@dataclass(frozen=True, slots=True)
class ObjectiveDocument:
    """The value of a plan at each level of the objective (`heronry_dg.objective`)."""

    critical: Mapping[str, int]  # by criticality class
    utility: int
    inputs: int
    changes: int
    branches: int
    bus_bits_per_s: int
    cpu_millis: int


@dataclass(frozen=True, slots=True)
class PlanDocument:
    """A plan with its situation, its objective, the proof of each level, its configuration and its report."""

    spec: str  # digest of the spec
    phase: str | None
    down: tuple[str, ...]
    limits: Mapping[str, str]  # by element, a percentage of its capacity
    priorities: Mapping[str, int]  # by function, where it is not that of the spec
    objective: ObjectiveDocument
    optimal: bool
    levels: tuple[LevelReport, ...]  # most important first
    modules: Mapping[str, Running]
    functions: Mapping[str, FunctionReport]
    pes: Mapping[str, PeReport]
    buses: Mapping[str, BusReport]

    def served(self) -> list[str]:
        """Return the functions that are served, in the order of the spec."""
        return [name for name, function in self.functions.items() if function.served]


def in_order_of_inputs(configuration: Configuration) -> dict[str, Running]:
    """Return the running modules, each with its inputs in the order of their paths."""
    return {
        name: Running(running.pe, running.mode, dict(sorted(running.inputs.items())))
        for name, running in configuration.modules.items()
    }


def plain_object(record: object) -> Json:
    """Return a data class as a JSON object: its fields in their order."""
    return {one.name: plain(getattr(record, one.name)) for one in fields(record)}  # type: ignore[arg-type]


def plain(value: object) -> object:
    """Return a value as plain data: data classes become objects, sequences lists, and all else stays."""
    if is_dataclass(value):
        return plain_object(value)
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value
