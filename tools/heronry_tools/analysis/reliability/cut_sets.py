"""The cut sets of one function: the smallest sets of faults that lose it.

A function is *lost* when no legal configuration of the remaining elements serves it, even if every other
function is given up. So a loss does not depend on which other functions are wanted. A *cut set* is a smallest
set of faults that loses the function. Every set that contains a cut set loses the function, too, since more
faults leave fewer configurations (`heronry_dg.losses`). So the cut sets of a function describe all sets that
lose it. There are two kinds of cut sets:

    logical     the graph cannot serve the function, even with unlimited CPU, memory, bandwidth and time, and
                without placement rules. A diagram has those of every order (`failure`, `diagrams`)
    resources   the remaining PEs and buses cannot carry what the function needs. Planning finds those of up to some
                order (`resource_sets`)

Every logical cut set also loses the function with real resources, but with real resources a smaller set may be enough.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from heronry_dg.model import Spec
from heronry_manager.planner.sweep import FaultSet, Scope
from heronry_tools.analysis.reliability.formula import TooLargeError
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.resource_sets import Journal, resource_sets, set_count
from heronry_tools.analysis.reliability.spec_hazards import hazards
from heronry_tools.console.errors import UserError

MOST_LISTED: Final = 1_000_000  # sets in memory at once


@dataclass(frozen=True)
class CutSets:
    """The cut sets of one function.

    logic: the failure of the function by the logic of the graph, of every order.
    resources: the cut sets with real resources of up to `order` faults; those that are logical are among them.
    """

    function: str
    order: int
    logic: Reliability
    resources: tuple[FaultSet, ...]

    @cached_property
    def logical(self) -> tuple[FaultSet, ...]:
        """The logical cut sets of up to `order` faults."""
        return tuple(self.logic.sets.sets(MOST_LISTED, self.order))


def logic_of(spec: Spec, function: str, scope: Scope) -> Reliability:
    """Solve the failure of a function in the one phase of `scope`, if only the elements of the scope can fail.

    A diagram that is too large is truncated. Raises UserError if the formula is too large.
    """
    (phase,) = scope.phases
    try:
        return Reliability(spec.in_phase(phase), function, scope.elements, hazards(spec))
    except TooLargeError as error:
        raise UserError(
            f"the failure of {function} is too large to be written down; let fewer --kinds of elements fail"
        ) from error


def elements_searched(logic: Reliability, scope: Scope) -> tuple[str, ...]:
    """Return the elements of the scope that can matter to the function, in the order of the scope."""
    return tuple(one for one in scope.elements if one in logic.failure.reach)


def sets_searched(logic: Reliability, scope: Scope) -> int:
    """Return the number of fault sets among which the resource-aware ones are searched."""
    return set_count(len(elements_searched(logic, scope)), scope.faults)


def cut_sets(
    spec: Spec,
    function: str,
    scope: Scope,
    logic: Reliability | None = None,
    *,
    executor: Executor | None = None,
    journal: Journal | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> CutSets:
    """Find the cut sets of a function in the one phase of `scope`.

    logic: the solved logic of the function, if it is known.
    executor, journal, advance: see `resource_sets`.

    Raises UserError if a search finds no answer, or if the formula is too large.
    """
    (phase,) = scope.phases
    logic = logic or logic_of(spec, function, scope)
    logical = tuple(logic.sets.sets(MOST_LISTED, scope.faults))
    searched = elements_searched(logic, scope)
    resources = resource_sets(
        spec.in_phase(phase),
        function,
        searched,
        scope.faults,
        logical,
        executor=executor,
        journal=journal,
        advance=advance,
    )
    return CutSets(function, scope.faults, logic, resources)
