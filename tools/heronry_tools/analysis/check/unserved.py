"""The check of DG310 and DG311: wanted functions that the best plan of a phase does not serve, with everything up.

A function is left to other rules in two cases:

- One of its modules fits no PE, or reads what no module gives. So it could not be served even if a manager reached
  every PE. The rules of the graph, and DG301, report the module.
- A rule about resources (DG303 to DG306) has reported the function in this phase.

The phases are planned only if it is not certain without a plan that their best plans serve everything: if one
configuration serves all wanted functions, each with its best value, then no plan has more utility.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final

from heronry_dg.check.subject import Subject
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Function, Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager.planner.explain import explained
from heronry_tools.analysis.check import resource_rules as rules
from heronry_tools.analysis.check.wanted import Phase, in_phases
from heronry_tools.analysis.servable import Planning
from heronry_tools.analysis.why.assumptions import in_words
from heronry_tools.analysis.why.reasons import reasons
from heronry_tools.console.errors import UserError

Wanted = Mapping[Phase, frozenset[str]]
_FEW_MODULES: Final = 60


def with_reach(spec: Spec) -> Spec:
    """Return the spec with every PE on the manager's bus, if no manager reaches it; the other PEs are unchanged."""
    commanded = survivors(spec, Situation()).pe_cpu_millis
    pes = {name: pe if name in commanded else replace(pe, buses=(spec.manager.bus,)) for name, pe in spec.pes.items()}
    return replace(spec, pes=pes)


def serves_everything(planning: Planning, wanted: Wanted) -> bool:
    """Tell whether it is certain that the best plan of each phase serves all wanted functions, each as well as it can.

    False if it is not certain; a plan has to tell then.
    """
    spec = planning.spec
    best = {name: _best_value(spec, function) for name, function in spec.functions.items()}
    if not all(best[name] for names in wanted.values() for name in names):
        return False  # a function without value may be left out though there is room for it
    if all(planning.in_phase(phase) is planning for phase in wanted):
        together = frozenset[str]().union(*wanted.values())
        return planning.all_at_once(together, least=best).configuration is not None
    return all(
        planning.in_phase(phase).all_at_once(names, least=best).configuration is not None
        for phase, names in wanted.items()
    )


def _best_value(spec: Spec, function: Function) -> int:
    return max(function.value_of(0, len(spec.modules[output].modes)) for output in function.outputs)


def check_unserved(
    subject: Subject, findings: Findings, planning: Planning, wanted: Wanted, told: Mapping[Phase, Collection[str]]
) -> None:
    """Add a finding for each function of `wanted` that is not served, with its phases and the reason.

    told: the functions that other findings are about, by phase.
    """
    spec = subject.spec
    by_reason: dict[tuple[str, str, bool], list[Phase]] = {}
    for phase, names in wanted.items():
        left = names - frozenset(told.get(phase, ()))
        if not left:
            continue
        for name, reason in _unserved(planning, phase, left):
            lesser = spec.functions[name].criticality_in(phase) == CRITICALITIES[-1]
            by_reason.setdefault((name, reason, lesser), []).append(phase)
    for (name, reason, lesser), at in by_reason.items():
        function = spec.functions[name]
        classes = "/".join(dict.fromkeys(function.criticality_in(phase) for phase in at))
        sentence = f"function '{name}' (class {classes}) is never served{in_phases(spec, at)}: {reason}"
        rule = rules.LESSER_NEVER_SERVED if lesser else rules.NEVER_SERVED
        hint = f"`heronry why {subject.file} {name}` tells more"
        findings.add(rule, subject.place("functions", name), sentence, hint)


def _unserved(planning: Planning, phase: Phase, names: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Yield the functions of `names` that the best plan of a phase does not serve, each with the reason."""
    healthy = planning.healthy(phase)
    lost = [name for name in planning.spec.functions if name in names and not healthy.functions[name].served]
    if lost:
        told = explained(planning.spec, healthy).functions
        yield from ((name, told[name].why_not or "") for name in lost)


def short_of(planning: Planning, phase: Phase, name: str) -> str:
    """Name what keeps a function from being served beside the others, as `heronry why` does; "" if that is not found.

    A large spec gets no such search, which asks the planner once for each PE, bus and function.
    """
    spec = planning.spec
    if len(spec.modules) > _FEW_MODULES:
        return ""
    try:
        found = reasons(spec, planning.healthy(phase), spec.functions[name])
    except UserError:
        return ""  # the planner did not decide in time
    others = [in_words(spec, one) for one in found if one.kind != "function"]
    return f", since {listed(others)}" if others else ""
