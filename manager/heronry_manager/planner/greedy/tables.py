"""A spec in integers, worked out once: what the greedy planner looks up while it plans.

Everything that depends on the spec and the phase alone is here; what depends on faults is a `Scene`. It is made in this
order, each part of those before:

    numbering        the number of each element
    sizes            what modes take, what PEs have, where a mode could run
    leaves           inputs and gates
    orders           which of them is tried first
    placement_rules  rules between modules
    routes           buses
    wanted           the functions of a phase
"""

from dataclasses import dataclass, field

from heronry_dg.model import Spec
from heronry_manager.planner.greedy.leaves import Leaves, numbered_leaves
from heronry_manager.planner.greedy.numbering import Numbering, numbered
from heronry_manager.planner.greedy.orders import Orders, ordered
from heronry_manager.planner.greedy.placement_rules import PlacementRules, placement_rules
from heronry_manager.planner.greedy.routes import Routes, routed
from heronry_manager.planner.greedy.sizes import Sizes, sized_up
from heronry_manager.planner.greedy.wanted import Wanted, wanted_in


@dataclass(frozen=True, slots=True)
class Tables:
    """All tables of one spec."""

    numbers: Numbering
    sizes: Sizes
    leaves: Leaves
    orders: Orders
    rules: PlacementRules
    routes: Routes
    _wanted: dict[str | None, Wanted] = field(default_factory=dict)

    def wanted(self, phase: str | None) -> Wanted:
        """What a phase wants; worked out once for each."""
        if phase not in self._wanted:
            self._wanted[phase] = wanted_in(self.numbers, self.orders.price, phase)
        return self._wanted[phase]


def tables_of(spec: Spec) -> Tables:
    """Work out the tables of a spec: some milliseconds."""
    numbers = numbered(spec)
    sizes, leaves = sized_up(numbers), numbered_leaves(numbers)
    return Tables(
        numbers=numbers,
        sizes=sizes,
        leaves=leaves,
        orders=ordered(leaves, numbers.module_of, sizes.size),
        rules=placement_rules(numbers),
        routes=routed(numbers),
    )
