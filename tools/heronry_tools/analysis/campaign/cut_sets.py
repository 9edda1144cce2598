"""The smallest sets of faults that lose a function.

A function is *lost* when no legal configuration of the remaining elements serves it, even if every other
function is given up. So a loss does not depend on which other functions are wanted. A *cut set* is a smallest
set of faults that loses the function. Every set that contains a cut set loses the function, too, since more
faults leave fewer configurations (`heronry_dg.losses`). So the cut sets of a function describe all sets that
lose it. There are two kinds of cut sets:

    logical     the graph cannot serve the function, even with unlimited CPU, memory, bandwidth and time, and
                without placement rules
    resources   the remaining PEs and buses cannot carry what the function needs

Every logical cut set also loses the function with real resources, but with real resources a smaller set may be enough.

The best plan of a phase may also *give up* a function that could be served, for a more important function. That is no
loss as defined above. A further fault may make the more important function impossible, and then the best plan serves
the given-up function again. So if the best plan gives up a function after some fault set, it need not do so after a
larger one. For this reason `given_up` needs a sweep: the best plan of every fault set.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from heronry_dg.model import Function, Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope, what_is_left
from heronry_tools.analysis.campaign.minimal import minimal
from heronry_tools.analysis.check.servable import Planning, without_limits
from heronry_tools.console.errors import UserError


@dataclass(frozen=True, slots=True)
class CutSets:
    """The cut sets of one function that have at most `order` faults each."""

    function: str
    order: int
    logical: tuple[FaultSet, ...]
    resources: tuple[FaultSet, ...]


def cut_sets(spec: Spec, function: str, scope: Scope, advance: Callable[[int], None] = lambda _: None) -> CutSets:
    """Find the cut sets of a function in the one phase of `scope`.

    advance: called with 1 after each fault set that is examined or skipped.
    """
    (phase,) = scope.phases
    spec = spec.in_phase(phase)
    logical, resources = (
        tuple(_smallest(Servable(planned, function), scope, advance)) for planned in (without_limits(spec), spec)
    )
    return CutSets(function, scope.faults, logical, resources)


def _smallest(servable: "Servable", scope: Scope, advance: Callable[[int], None]) -> Iterator[FaultSet]:
    """Yield the smallest fault sets after which the function cannot be served, smaller sets first.

    A set that contains one of the sets found before is skipped.
    """
    found: list[FaultSet] = []
    for size in scope.sizes():
        for down in scope.of_size(size):
            if not any(cut <= down for cut in found) and not servable.after(down):
                found.append(down)
                yield down
            advance(1)


class Servable:
    """Tells for a fault set whether any legal configuration can still serve one function."""

    def __init__(self, spec: Spec, function: str) -> None:
        self._planning, self._function = Planning(spec), function
        self._by_rest: dict[object, bool] = {}

    def after(self, down: FaultSet) -> bool:
        """Tell whether a legal configuration can serve the function while the elements in `down` are down.

        Raises UserError if the search finds no answer to this question.
        """
        if self._planning.survives((self._function,), down):
            return True
        rest = what_is_left(survivors(self._planning.spec, Situation(down)))
        if rest not in self._by_rest:
            answer = self._planning.all_at_once((self._function,), down)
            if not answer.proven:
                lost = ", ".join(sorted(down)) or "nothing"
                raise UserError(
                    f"the search reached its limit before it was known whether function {self._function} can be served "
                    f"with {lost} down; lower --order, or simplify what serves this function in the spec"
                )
            self._by_rest[rest] = answer.configuration is not None
        return self._by_rest[rest]


def given_up(
    function: Function, cuts: CutSets, phase: Phase, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]
) -> list[FaultSet]:
    """Find the smallest fault sets after which the best plan of a phase leaves out a function that could be served."""
    sets = [
        down
        for (at, down), outcome in outcomes.items()
        if at == phase
        and not any(output in outcome.configuration.modules for output in function.outputs)
        and not any(cut <= down for cut in cuts.resources)
    ]
    return minimal(sets)
