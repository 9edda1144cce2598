"""The tables of the greedy planner: a spec in integers.

All parts but `wanted` depend only on the spec, and are worked out once for a spec. `wanted` also depends on the phase
and on changed priorities. What depends on faults is in a `Scene`. The parts are made in this order, each from the parts
before it:

    numbering        the number of each element
    sizes            the resources of modes and of PEs; the PEs on which each mode could run
    leaves           inputs and gates
    orders           the order in which the inputs of gates, and the modes that may feed them, are tried
    placement_rules  rules between modules
    routes           buses
    wanted           the functions of a phase, with their priorities
"""

from dataclasses import dataclass, field

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.planner.greedy.leaves import Leaves, numbered_leaves
from heronry_manager.planner.greedy.numbering import Numbering, numbered
from heronry_manager.planner.greedy.orders import Orders, ordered
from heronry_manager.planner.greedy.placement_rules import PlacementRules, placement_rules
from heronry_manager.planner.greedy.routes import Routes, routed
from heronry_manager.planner.greedy.sizes import Sizes, sized_up
from heronry_manager.planner.greedy.wanted import Wanted, wanted_in


@dataclass(frozen=True, slots=True)
class Tables:
    """One spec in the integers with which the greedy planner works."""

    numbers: Numbering
    sizes: Sizes
    leaves: Leaves
    orders: Orders
    rules: PlacementRules
    routes: Routes
    _wanted: dict[str | None, Wanted] = field(default_factory=dict)

    def wanted(self, now: Situation) -> Wanted:
        """Return the wanted functions of a situation, with their priorities.

        The result for a phase with the spec's own priorities is computed once and kept. Results for changed priorities
        are not kept, since there may be any number of such changes.
        """
        if now.priorities:
            return wanted_in(self.numbers, self.orders.price, now)
        if now.phase not in self._wanted:
            self._wanted[now.phase] = wanted_in(self.numbers, self.orders.price, now)
        return self._wanted[now.phase]


def tables_of(spec: Spec) -> Tables:
    """Work out the tables of a spec; this takes some milliseconds."""
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
