"""The check of DG253: where a module fails when it falls silent, something takes its place."""

from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings, listed
from heronry_dg.rules import silence as rules
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_dg.why_not import Feasible, feasible


def check_silence(subject: Subject, findings: Findings) -> None:
    """Add a finding for each module with `silent: fails` without which a function is impossible, if it has one PE."""
    spec = subject.spec
    strict = [
        one for one in spec.modules.values() if one.silent == "fails" and len(hosts_when_all_is_up(spec, one)) == 1
    ]
    possible = _possible(feasible(spec, Situation())) if strict else []
    for module in strict:
        left = _possible(feasible(spec, Situation(frozenset((f"module:{module.name}",)))))
        lost = [function for function in possible if function not in left]
        if lost:
            sentence = (
                f"module {module.name} fails when it falls silent, and then {listed(lost, 'and')} cannot be served"
            )
            remedy = "leave 'silent' out, or give another module that can take over"
            findings.add(rules.FAILS_ALONE, subject.place("modules", module.name, "silent"), sentence, remedy)


def _possible(found: Feasible) -> list[str]:
    """Return the functions that could be served with unlimited resources."""
    modules = found.spec.modules
    return [one.name for one in found.spec.functions.values() if any(found.can_run(modules[o]) for o in one.outputs)]
