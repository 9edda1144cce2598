"""The functions that each phase of a spec wants, and phases in the text of findings."""

from collections.abc import Collection

from heronry_dg.field_types import CRITICALITIES
from heronry_dg.findings import listed
from heronry_dg.model import Spec

Phase = str | None


def phases(spec: Spec) -> tuple[Phase, ...]:
    """Name the phases of a spec; for a spec without phases, None stands for the only one."""
    return tuple(spec.phases) or (None,)


def wanted_functions(spec: Spec, phase: Phase) -> frozenset[str]:
    """Name the functions whose priority in a phase is not 0."""
    return frozenset(name for name, function in spec.functions.items() if function.priority_in(phase) > 0)


def critical_functions(spec: Spec, phase: Phase) -> frozenset[str]:
    """Name the functions of class A to D whose priority in a phase is not 0."""
    least = CRITICALITIES[-1]
    return frozenset(
        name for name in wanted_functions(spec, phase) if spec.functions[name].criticality_in(phase) != least
    )


def in_phases(spec: Spec, chosen: Collection[Phase]) -> str:
    """Write the phases as ` in glide and landing`; an empty text for a spec without phases."""
    if not spec.phases:
        return ""
    if len(chosen) == len(spec.phases):
        return " in every phase"
    return f" in {listed(phase for phase in spec.phases if phase in chosen)}"
