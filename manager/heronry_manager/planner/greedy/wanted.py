"""The functions that a situation wants, in the order in which the planner serves them.

For each of these functions, this file also computes how much each mode of its output module adds to levels 1 and 2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Function
from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.situation import Situation
from heronry_manager.planner.greedy.numbering import Numbering


@dataclass(frozen=True, slots=True)
class Goal:
    """A wanted function, with the modules that can be its output (`outputs`) and their modes (`modes`).

    Modules and modes are given by their numbers in the planner.
    """

    name: str
    rank: int  # 0 (A) to 4 (E)
    priority: int
    outputs: tuple[int, ...]  # modules
    modes: tuple[int, ...]  # of its outputs, the most valuable first


@dataclass(frozen=True, slots=True)
class Wanted:
    """The functions that a situation wants, and what each mode of their outputs adds to levels 1 and 2."""

    goals: tuple[Goal, ...]  # most important first
    outputs: int  # modules that serve by running: a set, as bits by number of the module
    output_modules: tuple[int, ...]  # `outputs`, as a list
    weight: Mapping[int, int]  # mode of an output -> levels 1 and 2 in one number
    utility_bound: int  # level 2 is less than this: weight = critical classes * utility_bound + utility

    def score(self, modes: Sequence[int]) -> int:
        """Return the value at levels 1 and 2 as one number; `modes`: the mode of each module, -1 if it does not run."""
        weight = self.weight
        return sum(weight[modes[module]] for module in self.output_modules if modes[module] >= 0)


def wanted_in(numbers: Numbering, price: Sequence[int], now: Situation) -> Wanted:
    """Work out the wanted functions of a situation, by its phase and priorities.

    price: by number of a mode, the CPU, RAM and flash that the mode takes together with its cheapest producers,
        as one sum of shares (`orders`).
    """
    appraiser = _Appraiser(numbers, now)
    functions = [one for one in numbers.spec.functions.values() if now.priority_of(one) > 0]
    goals = sorted(map(appraiser.goal, functions), key=lambda goal: _urgency(goal, price))
    worth = {
        mode: sum(appraiser.utility(one, mode) for one in functions)
        for mode in {m for goal in goals for m in goal.modes}
    }
    bound = 1 + sum(
        max((appraiser.utility(one, m) for m in appraiser.output_modes(one)), default=0) for one in functions
    )
    classes = _class_weights(goals)
    outputs = sorted({module for goal in goals for module in goal.outputs})
    return Wanted(
        goals=tuple(goals),
        outputs=sum(1 << module for module in outputs),
        output_modules=tuple(outputs),
        weight={
            mode: worth[mode] + bound * sum(classes[goal.rank] * goal.priority for goal in goals if mode in goal.modes)
            for mode in worth
        },
        utility_bound=bound,
    )


class _Appraiser:
    """Works out how much each function of a situation counts at levels 1 and 2."""

    def __init__(self, numbers: Numbering, now: Situation) -> None:
        self._numbers, self._now = numbers, now

    def goal(self, function: Function) -> Goal:
        modes = self.output_modes(function)
        return Goal(
            name=function.name,
            rank=CRITICALITIES.index(function.criticality_in(self._now.phase)),
            priority=self._now.priority_of(function),
            outputs=tuple(self._numbers.module_number[name] for name in function.outputs),
            modes=tuple(sorted(modes, key=lambda mode: -self.utility(function, mode))),
        )

    def output_modes(self, function: Function) -> list[int]:
        numbers = self._numbers
        return [mode for name in function.outputs for mode in numbers.modes_of[numbers.module_number[name]]]

    def utility(self, function: Function, mode: int) -> int:
        """Return the points that `mode` adds to level 2 by serving a function; 0: this mode does not serve it."""
        numbers, module = self._numbers, self._numbers.module_of[mode]
        if numbers.modules[module].name not in function.outputs:
            return 0
        modes = numbers.modes_of[module]
        return self._now.priority_of(function) * function.value_of(modes.index(mode), len(modes))


def _urgency(goal: Goal, price: Sequence[int]) -> tuple[int, int, int]:
    """Return the key by which functions are sorted, the most important one first.

    price: by number of a mode, the CPU, RAM and flash that the mode takes together with its cheapest producers, as
        one sum of shares (`orders`).
    """
    cheapest = 1 + min((price[mode] for mode in goal.modes), default=0)
    # the class; the priority of a critical function; that of any other one per price of its cheapest mode
    return goal.rank, -goal.priority if goal.rank < len(CRITICAL_CLASSES) else 0, -(goal.priority * 10**9 // cheapest)


def _class_weights(goals: Sequence[Goal]) -> list[int]:
    """Return the weight of each class, A to E; E has weight 0.

    For each served function, weight is multiplied by priority, and the products are added. Of two plans, that with
    the greater sum is the better one at level 1.
    """
    weights = [0] * len(CRITICALITIES)
    weight = 1
    for rank in reversed(range(len(CRITICAL_CLASSES))):
        weights[rank] = weight
        weight *= 1 + sum(goal.priority for goal in goals if goal.rank == rank)
    return weights
