"""The smallest sets of faults that lose a function.

*Lost* means that no legal configuration of what is left serves it, whatever else would have to be given up. That is
monotone: more faults leave fewer configurations (`heronry_dg.losses`), so every set that contains a cut set loses the
function, too, and the smallest ones tell everything. It does not depend on the phase, nor on what else is wanted:
a configuration that serves a function beside others can serve it alone, too.

    logical     the graph cannot: not even with unlimited CPU, memory, bandwidth and time, and no placement rules
    resources   the survivors cannot: with what PEs and buses can carry

Every logical cut set loses the function with real resources, too; some are not the smallest any more then.

What the best plan of a phase *gives up* for something more important is another matter. It is not monotone: one more
fault may take that something away, and the function comes back. It is read from a sweep, and the smallest sets do not
tell about the sets that contain them.
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
    """Cut sets of one function, up to an order."""

    function: str
    order: int
    logical: tuple[FaultSet, ...]
    resources: tuple[FaultSet, ...]


def cut_sets(spec: Spec, function: str, scope: Scope, advance: Callable[[int], None] = lambda _: None) -> CutSets:
    """Find all cut sets of a function up to the scope's number of faults; `advance` counts the sets examined."""
    logical, resources = (
        tuple(_smallest(Servable(planned, function), scope, advance)) for planned in (without_limits(spec), spec)
    )
    return CutSets(function, scope.faults, logical, resources)


def _smallest(servable: "Servable", scope: Scope, advance: Callable[[int], None]) -> Iterator[FaultSet]:
    """Go through the sets by size: one that contains a cut set is none of the smallest."""
    found: list[FaultSet] = []
    for size in scope.sizes():
        for down in scope.of_size(size):
            if not any(cut <= down for cut in found) and not servable.after(down):
                found.append(down)
                yield down
            advance(1)


class Servable:
    """Whether one function can be served at all, fault set by fault set."""

    def __init__(self, spec: Spec, function: str) -> None:
        self._planning, self._function = Planning(spec), function
        self._by_rest: dict[object, bool] = {}

    def after(self, down: FaultSet) -> bool:
        """Tell whether some legal configuration serves it; raises UserError where the search does not decide that."""
        if self._planning.survives((self._function,), down):
            return True
        rest = what_is_left(survivors(self._planning.spec, Situation(down)))
        if rest not in self._by_rest:
            answer = self._planning.all_at_once((self._function,), down)
            if not answer.proven:
                lost = ", ".join(sorted(down)) or "nothing"
                raise UserError(f"with {lost} down the search did not decide whether {self._function} can be served")
            self._by_rest[rest] = answer.configuration is not None
        return self._by_rest[rest]


def given_up(
    function: Function, cuts: CutSets, phase: Phase, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]
) -> list[FaultSet]:
    """Find the smallest sets after which the best plan of a phase gives up a function that could be served."""
    sets = [
        down
        for (at, down), outcome in outcomes.items()
        if at == phase
        and not any(output in outcome.configuration.modules for output in function.outputs)
        and not any(cut <= down for cut in cuts.resources)
    ]
    return minimal(sets)
