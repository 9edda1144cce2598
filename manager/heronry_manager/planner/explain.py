"""Why a function is not served although the faults alone would allow it: there is no room for it.

`heronry_dg.why_not` finds causes that follow from faults alone. If there is no such cause, this file solves a smaller
problem: can the function be served if no other function is wanted? If not, no plan has room for it. If so, more
important functions take the room. Deadlines are analysed with the identifiers of the whole spec, since these
identifiers are used on the bus.
"""

from dataclasses import replace

from heronry_dg.model import Function, Spec
from heronry_dg.plan import Plan
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation
from heronry_dg.why_not import feasible, why_not
from heronry_manager.planner.candidates import candidates
from heronry_manager.planner.exact import Search

_EFFORT = 5.0  # deterministic seconds for each function


def explained(spec: Spec, plan: Plan) -> Plan:
    """Return the plan with better reasons for the functions that it does not serve.

    A search is needed for each wanted function that is not served although a module for it can run.
    """
    found = feasible(spec, plan.now)
    reasons = {name: report.why_not for name, report in plan.functions.items() if report.why_not is not None}
    for name, report in plan.functions.items():
        function = spec.functions[name]
        outputs = [spec.modules[output] for output in function.outputs]
        if not report.served and plan.now.priority_of(function) and any(map(found.can_run, outputs)):
            alone = _servable_alone(spec, plan.now, function)
            reasons[name] = why_not(found, function, alone=alone)
    return replace(plan, report=plan.report.with_reasons(reasons))


def _servable_alone(spec: Spec, now: Situation, function: Function) -> bool | None:
    """Tell whether a function could be served if no other one were wanted; None: the search did not decide it."""
    wanted = replace(function, criticality={None: "A"}, priority={None: 1})
    possible = candidates(replace(spec, functions={function.name: wanted}), now)
    search = Search(possible, None, ResponseTimes(spec), _EFFORT)
    search.run(groups=1)
    if search.best.modules:
        return True
    return False if search.proven else None
