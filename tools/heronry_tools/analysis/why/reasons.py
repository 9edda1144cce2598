"""Why a function is not served as well as it could be: irreducible reasons, and the smallest repairs.

*The plan* is the best plan of the situation that is explained. The *goal* has two parts:

- the function is served, or, if the plan serves it in a worse mode, it is served in its best mode;
- every other function is served as well as in the plan.

A configuration that reaches the goal would usually be better than the plan. But the plan is the best one, so the goal
is impossible, and this file finds out why. There is one exception: if the function adds too little to the value of a
plan, it may be left out although the goal is possible. Then there are no reasons and no repairs.

*Reasons.* The assumptions (`assumptions`) together make the goal impossible. They are relaxed one after the
other. If the goal is still impossible without an assumption, that assumption stays relaxed (a deletion
filter). The assumptions that are left are irreducible: if any one of them were relaxed, too, the goal would
be possible. There may be several irreducible sets; only one is shown. The assumptions that explain least are
relaxed first. So such an assumption is in the set that is shown only if the set cannot do without it.

*Repairs.* A repair relaxes at least one assumption of every irreducible set. The smallest repair is found in steps:

1. Find the smallest set that has a member of each irreducible set known so far (a smallest hitting set).
2. If the planner reaches the goal with this set relaxed, the set is the smallest repair.
3. If not, find a further irreducible set, and begin again at step 1.

A repair can only bring back elements that are down, or the whole capacity of an element, or add CPU, memory or
bandwidth. The amount of a capacity that is needed is found by bisection. A repair counts only if the planner, given the
repaired system, really serves the function.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

from heronry_dg.model import Function, Spec
from heronry_dg.objective import placement
from heronry_dg.plan import Plan
from heronry_dg.plan_report import FunctionReport
from heronry_dg.shortfalls import shortfalls_of
from heronry_dg.situation import Situation
from heronry_manager.planner.exact import plan
from heronry_manager.planner.explain import explained
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.reliability.formula import TooLargeError
from heronry_tools.analysis.servable import PLENTY, Planning
from heronry_tools.analysis.why.assumptions import (
    CAPACITIES,
    MENDABLE,
    Assumption,
    Question,
    assumptions,
    capacity,
    relaxed,
    with_capacity,
)
from heronry_tools.console.errors import UserError

_MOST_SETS: Final = 20  # logical cut sets that are told
_MOST_TRIES: Final = 40  # hitting sets that are tried; the shipped specs need a few
_MOST_PARTS: Final = 4  # most elements and capacities of one repair

Possible = Callable[[Iterable[Assumption]], bool]
"""Tells whether the goal is possible without some assumptions."""


@dataclass(frozen=True, slots=True)
class Repair:
    """A repair: the elements to bring back, and the capacities to enlarge.

    whole: the elements that have their whole capacity again.
    capacities: each capacity, with the amount that it must have in all (not the increase).
    """

    restore: tuple[str, ...]
    whole: tuple[str, ...]
    capacities: tuple[tuple[Assumption, int], ...]


@dataclass(frozen=True, slots=True)
class Explanation:
    """Whether and how a function is served, the reasons why it is not served better, and the repairs.

    shortfalls: what is less than the best in the output module and upstream of it, if the function is served.
    logical: if the function is not served, the smallest sets of what is down without which no resources would help.
    """

    function: Function
    now: Situation
    report: FunctionReport
    best_value: int
    reasons: tuple[Assumption, ...]
    repairs: tuple[Repair, ...]  # all with one part; if there are none, one smallest repair; empty: none helps
    logical: tuple[frozenset[str], ...] = ()
    shortfalls: tuple[str, ...] = ()


def explain(spec: Spec, now: Situation, function: Function) -> Explanation:
    """Explain how a function is served in a situation.

    It is assumed that the best plan with everything up ran before the faults.

    Raises UserError if the planner does not decide in time what is possible.
    """
    healthy = plan(spec, Situation(phase=now.phase))
    found = explained(
        spec, plan(spec, now, placement(healthy.configuration)) if now != Situation(phase=now.phase) else healthy
    )
    report = found.functions[function.name]
    best_value = max(
        function.value_of(0, len(spec.modules[output].modes)) for output in function.outputs
    )  # modes are listed best first
    unknown = Explanation(function, now, report, best_value, (), (), shortfalls=shortfalls_of(spec, found, function))
    if now.priority_of(function) == 0 or (report.served and report.value >= best_value):
        return unknown
    question = _question(spec, found, function, best_value if report.served else 0)
    every, possible = assumptions(question, function.name), _possible(question)
    if possible(()) or not possible(every):  # it adds too little to the value of a plan, or nothing can be relaxed
        return unknown
    return replace(
        unknown,
        logical=() if report.served else _lost_by_logic(spec, now, function),
        reasons=tuple(_irreducible(every, possible)),
        repairs=tuple(_repairs(question, every, function, now, possible)),
    )


def _lost_by_logic(spec: Spec, now: Situation, function: Function) -> tuple[frozenset[str], ...]:
    try:
        found = failure(spec.in_phase(now.phase), function.name, now.down)
        return tuple(Solution(found.formula, found.root).sets(_MOST_SETS))
    except TooLargeError:
        return ()


def reasons(spec: Spec, found: Plan, function: Function) -> tuple[Assumption, ...]:
    """Return the reasons why the best plan of a situation does not serve a function; there may be none.

    Raises UserError if the planner does not decide in time what is possible.
    """
    question = _question(spec, found, function, 0)
    every, possible = assumptions(question, function.name), _possible(question)
    if possible(()) or not possible(every):
        return ()
    return tuple(_irreducible(every, possible))


def _possible(question: Question) -> Possible:
    return lambda without: _is_possible(relaxed(question, tuple(without)))


def _question(spec: Spec, found: Plan, function: Function, least: int) -> Question:
    others = {name: report.value for name, report in found.functions.items() if report.served}
    return Question(spec.in_phase(found.now.phase), found.now.down, found.now.limits, {**others, function.name: least})


def _is_possible(question: Question) -> bool:
    answer = Planning(question.spec).all_at_once(tuple(question.least), question.down, question.least, question.limits)
    if not answer.proven:
        raise UserError("the planner did not decide in time what is possible; give fewer faults")
    return answer.configuration is not None


def _irreducible(
    these: Sequence[Assumption], possible: Possible, without: Iterable[Assumption] = ()
) -> list[Assumption]:
    """Reduce the assumptions in `these` to an irreducible set, and return this set.

    Together, the assumptions of the set make the goal impossible. If any one of them were relaxed, too, the goal
    would be possible.

    possible: tells whether the goal is possible when the given assumptions are relaxed.
    without: assumptions that are relaxed from the beginning.
    """
    gone = list(without)
    kept = list(these)
    for one in these:
        if not possible([*gone, one]):
            gone.append(one)
            kept.remove(one)
    return kept


def _repairs(
    question: Question, every: Sequence[Assumption], function: Function, now: Situation, possible: Possible
) -> Iterator[Repair]:
    """Find the smallest repairs: all repairs with a single part; if there are none, one repair with more parts."""
    soft = [one for one in every if one.kind in MENDABLE]
    if not possible(soft):
        return
    size = None
    for parts in _hitting_repairs(soft, possible):
        if size is not None and (len(parts) > size or size > 1):
            return
        repair = _measured(question, parts)
        if _serves(question, repair, function, now):
            size = len(parts)
            yield repair


def _hitting_repairs(soft: Sequence[Assumption], possible: Possible) -> Iterator[tuple[Assumption, ...]]:
    """Yield sets of assumptions that make the goal possible when they are dropped, smaller sets first.

    None of these sets contains another one. At most `_MOST_TRIES` sets are tried.

    soft: the assumptions that may be dropped.
    possible: tells whether the goal is possible without the given assumptions.
    """
    cores: list[frozenset[Assumption]] = []
    found: list[frozenset[Assumption]] = []
    for _ in range(_MOST_TRIES):
        parts = _smallest_hitting(cores, found)
        if parts is None:
            return
        if possible(parts):
            found.append(frozenset(parts))
            yield parts
        else:
            cores.append(frozenset(_irreducible([one for one in soft if one not in parts], possible, parts)))


def _smallest_hitting(
    cores: Sequence[frozenset[Assumption]], found: Sequence[frozenset[Assumption]]
) -> tuple[Assumption, ...] | None:
    """Find a smallest set of assumptions that may be a repair; None if none has at most `_MOST_PARTS` members.

    The set has a member of every set in `cores`, and contains no set in `found`.

    cores: irreducible sets of assumptions that make the goal impossible.
    found: the repairs that are known already.
    """
    names = sorted(frozenset[Assumption]().union(*cores), key=lambda one: (MENDABLE.index(one.kind), one.name))
    for size in range(min(_MOST_PARTS, len(names)) + 1):
        for parts in combinations(names, size):
            chosen = frozenset(parts)
            if all(core & chosen for core in cores) and not any(known <= chosen for known in found):
                return parts
    return None


def _measured(question: Question, parts: tuple[Assumption, ...]) -> Repair:
    """Return the repair that relaxes the assumptions `parts`.

    For each capacity in `parts`, the repair has the least amount with which `question` is possible. The amounts
    are found one after the other, in the order of `parts`. While the amount of one capacity is searched, the
    capacities after it in `parts` are unlimited.
    """
    capacities = [one for one in parts if one.kind in CAPACITIES]
    repaired = relaxed(question, parts)
    needed = []
    for one in capacities:
        amount = _least_amount(repaired, one, capacity(question.spec, one))
        repaired = replace(repaired, spec=with_capacity(repaired.spec, one, amount))
        needed.append((one, amount))
    restored, whole = (tuple(one.name for one in parts if one.kind == kind) for kind in ("down", "limit"))
    return Repair(restored, whole, tuple(needed))


def _least_amount(question: Question, one: Assumption, there_is: int) -> int:
    """Find the least amount of a capacity with which `_is_possible` holds for a question.

    one: the assumption that names the capacity.
    there_is: the present amount of the capacity; `_is_possible` does not hold with this amount.
    """
    too_little, enough = there_is, max(1, 2 * there_is)
    while enough < PLENTY and not _is_possible(_with(question, one, enough)):
        too_little, enough = enough, 2 * enough
    while enough - too_little > 1:
        middle = (too_little + enough) // 2
        if _is_possible(_with(question, one, middle)):
            enough = middle
        else:
            too_little = middle
    return enough


def _with(question: Question, one: Assumption, amount: int) -> Question:
    return replace(question, spec=with_capacity(question.spec, one, amount))


def _serves(question: Question, repair: Repair, function: Function, now: Situation) -> bool:
    """Tell whether the best plan after the repair serves the function with at least the required value.

    repair: the elements that are up again, and the capacities that are changed.
    """
    spec = question.spec
    for one, amount in repair.capacities:
        spec = with_capacity(spec, one, amount)
    limits = {name: share for name, share in now.limits.items() if name not in repair.whole}
    repaired = replace(now, down=now.down - set(repair.restore), limits=limits)
    report = plan(spec, repaired).functions[function.name]
    return report.served and report.value >= question.least[function.name]
