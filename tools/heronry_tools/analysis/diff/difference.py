"""The difference of two specs: their elements, the consequences phase by phase, and the findings of `heronry check`.

What a change in flight would do to running modules is told of the phase in which the new spec begins: from the best
plan of the old spec to the best plan of the new one, which keeps what runs where it can.

A phase of the new spec is compared with the phase of the same name in the old spec. If the old spec has no phase of
this name, the old spec's first phase is used. A phase that only the old spec has is not compared.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.situation import Situation
from heronry_dg.spec_change import SpecChange, spec_change
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.diff.consequences import Consequences, PhaseConsequences
from heronry_tools.analysis.diff.elements import ElementChange, element_changes
from heronry_tools.analysis.diff.findings import FindingsChange

V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class Moved:
    """The change in the single points of failure of one function.

    gone: elements that are no longer single points of failure. new: elements that have become single points of failure.
    left: elements that are single points of failure in both specs.
    """

    gone: tuple[str, ...]
    new: tuple[str, ...]
    left: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PhaseDifference:
    """What differs between the specs in one phase; each pair has the old value, then the new value."""

    phase: str | None  # the phase of the new spec; None for a spec without phases
    against: str | None  # the phase of the old spec
    functions: Mapping[str, tuple[str | None, str | None]]  # as `PhaseConsequences.served`; None also: no such function
    hangs_on: Mapping[str, Moved]  # by function
    buses: Mapping[str, tuple[int, int]]  # bus -> load in bit/s
    cpu_millis: tuple[int, int]  # load of all PEs, in thousandths of a core

    def is_none(self) -> bool:
        """Tell whether the two specs do not differ in this phase."""
        return not (self.functions or self.hangs_on or self.buses) and self.cpu_millis[0] == self.cpu_millis[1]


@dataclass(frozen=True, slots=True)
class Difference:
    """Everything about a changed spec that a reviewer should see: changes of elements, consequences, findings."""

    old: Spec
    new: Spec
    elements: tuple[ElementChange, ...]
    phases: tuple[PhaseDifference, ...]
    findings: FindingsChange
    in_flight: SpecChange | None  # None where no element differs

    def has_another_digest(self) -> bool:
        """Tell whether tables, contingencies and journals of the old spec are strangers to the new one."""
        return self.old.digest != self.new.digest


def difference(old: Spec, new: Spec, findings: FindingsChange) -> Difference:
    """Compare two specs; `findings` are the differing findings of `heronry check`."""
    changes = element_changes(old, new)
    if not changes:
        return Difference(old, new, (), (), findings, None)
    consequences = Consequences()
    before, after = consequences.of(old), consequences.of(new)
    return Difference(old, new, changes, tuple(_phases(old, before, after)), findings, _in_flight(old, new, before))


def _in_flight(old: Spec, new: Spec, before: Mapping[str | None, PhaseConsequences]) -> SpecChange:
    """Compare what runs of the old spec with the best plan of the new one in its first phase, nothing being down."""
    now = Situation(phase=new.initial_phase())
    running = before[now.phase if now.phase in before else old.initial_phase()].running
    return spec_change(old, running, new, plan(new, now, placement(running)).configuration)


def _phases(
    old: Spec, before: Mapping[str | None, PhaseConsequences], after: Mapping[str | None, PhaseConsequences]
) -> Iterator[PhaseDifference]:
    for phase, becomes in after.items():
        against = phase if phase in before else old.initial_phase()
        was = before[against]
        yield PhaseDifference(
            phase,
            against,
            functions=_changed(was.served, becomes.served, None),
            hangs_on=dict(_moved(was.hangs_on, becomes.hangs_on)),
            buses=_changed(was.bus_bits_per_s, becomes.bus_bits_per_s, 0),
            cpu_millis=(was.cpu_millis, becomes.cpu_millis),
        )


def _changed(old: Mapping[str, V], new: Mapping[str, V], missing: V) -> dict[str, tuple[V, V]]:
    pairs = {name: (old.get(name, missing), new.get(name, missing)) for name in {**old, **new}}
    return {name: (was, becomes) for name, (was, becomes) in pairs.items() if was != becomes}


def _moved(old: Mapping[str, tuple[str, ...]], new: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, Moved]]:
    """Yield the functions of the new spec whose single points of failure have changed, each with the change."""
    for function, points in new.items():
        was = old.get(function, ())
        moved = Moved(
            gone=tuple(one for one in was if one not in points),
            new=tuple(one for one in points if one not in was),
            left=tuple(one for one in points if one in was),
        )
        if moved.gone or moved.new:
            yield function, moved
