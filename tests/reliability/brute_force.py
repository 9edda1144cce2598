"""Losses and probabilities by trying everything: no formula, no diagram, no planner.

`Losing` tells for each set of elements that are down whether a function can still be served, by trying every choice of
modes. As a program it compares the diagrams with that, over as many random specs as there is time for:

    PYTHONPATH=tests python -m reliability.brute_force 0 2000        seeds 0 to 1999

A disagreement is printed with its seed, and makes the exit code 1.
"""

import itertools
import random
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence

from heronry_dg.gates import Expression, Leaf, bounds
from heronry_dg.model import Mode, Spec
from heronry_dg.situation import Situation, elements, places, survivors
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from planner.random_specs import random_spec

Running = tuple[tuple[str, str], ...]  # modules, each with the mode in which it runs


class Losing:
    """Tells whether the graph of a spec can serve a function without some elements."""

    def __init__(self, spec: Spec, function: str) -> None:
        self._spec, self._function = spec, spec.functions[function]
        self._known: dict[frozenset[str], bool] = {}

    def __call__(self, down: Collection[str]) -> bool:
        left = survivors(self._spec, Situation(frozenset(down)))
        return self.without(frozenset(name for name, module in self._spec.modules.items() if left.hosts(module)))

    def without(self, placed: frozenset[str]) -> bool:
        """Tell whether the function is lost if only these modules can be placed."""
        if placed not in self._known:
            self._known[placed] = not any(self._serves(chosen) for chosen in self._chosen(sorted(placed)))
        return self._known[placed]

    def _chosen(self, modules: Sequence[str]) -> Iterator[Running]:
        """Yield every choice of a mode for some of the modules in which nothing runs beside what it excludes."""
        ways = [(None, *self._spec.modules[name].modes) for name in modules]
        for modes in itertools.product(*ways):
            running = [name for name, mode in zip(modules, modes, strict=True) if mode is not None]
            if not any(self._exclude(one, other) for one, other in itertools.combinations(running, 2)):
                yield tuple((name, mode) for name, mode in zip(modules, modes, strict=True) if mode is not None)

    def _exclude(self, one: str, other: str) -> bool:
        groups = [group for demux in self._spec.demuxes.values() for group in (demux.branches, demux.to)]
        if any(one in group and other in group for group in groups):
            return True
        device = self._spec.modules[one].device
        same = device is not None and device == self._spec.modules[other].device
        return same and self._spec.devices[device or ""].kind == "actuator"

    def _serves(self, running: Running) -> bool:
        modes = {name: self._spec.modules[name].modes[mode] for name, mode in running}
        while True:
            fed = {name for name, mode in modes.items() if mode.needs is None or _held(mode.needs, modes.values())}
            if len(fed) == len(modes):
                return any(output in modes for output in self._function.outputs)
            modes = {name: mode for name, mode in modes.items() if name in fed}


def _held(needs: Expression, running: Collection[Mode]) -> bool:
    if isinstance(needs, Leaf):
        return any(needs.variable in mode.gives and needs.accepts(mode.gives[needs.variable]) for mode in running)
    return sum(_held(one, running) for one in needs.inputs) >= bounds(needs)[0]


def subsets(names: Sequence[str]) -> Iterator[frozenset[str]]:
    """Yield all sets of some names, the smaller ones first."""
    for size in range(len(names) + 1):
        yield from map(frozenset, itertools.combinations(names, size))


def smallest(losing: Collection[frozenset[str]]) -> set[frozenset[str]]:
    """Return the sets of a collection, closed upwards, that stop losing as soon as they lack any of their members."""
    known = set(losing)
    return {down for down in known if not any(down - {one} in known for one in down)}


def chance(down: Collection[str], chances: Mapping[str, float]) -> float:
    """Return the probability that exactly these elements are down, and no other."""
    found = 1.0
    for name, its in chances.items():
        found *= its if name in down else 1.0 - its
    return found


def drawn_case(rng: random.Random, most: int = 12) -> tuple[Spec, str, list[str]]:
    """Draw a spec, one of its functions, and up to `most` elements of it that may fail."""
    spec = random_spec(rng, modules=5).in_phase(None)
    function = rng.choice(list(spec.functions))
    possible = [*elements(spec), *(place for module in spec.modules for place in places(spec, module))]
    return spec, function, rng.sample(possible, min(len(possible), rng.randint(1, most)))


def disagreement(rng: random.Random, most: int = 12) -> str | None:
    """Compare one random spec; gives a sentence if the diagrams are wrong about it."""
    spec, function, may_fail = drawn_case(rng, most)
    chances = {name: rng.choice((0.0, 1e-9, 1e-4, 0.03, 0.5, 1.0, rng.random())) for name in may_fail}
    lost = Losing(spec, function)
    losing = [down for down in subsets(may_fail) if lost(down)]
    found = failure(spec, function, may_fail)
    solution = Solution(found.formula, found.root)
    listed = list(solution.sets(10**6))
    if set(listed) != smallest(losing) or len(listed) != sum(solution.by_order().values()):
        return f"{function}: sets {sorted(map(sorted, listed))}, but {sorted(map(sorted, smallest(losing)))}"
    exact = sum(chance(down, chances) for down in losing)
    if abs(solution.probability(chances) - exact) > 1e-9 * exact:
        return f"{function}: probability {solution.probability(chances)}, but {exact}"
    return None


def main(first: int, last: int) -> int:
    """Compare the seeds from `first` to before `last`; gives the exit code."""
    wrong = 0
    for seed in range(first, last):
        found = disagreement(random.Random(seed))
        if found is not None:
            wrong += 1
            print(f"seed {seed}: {found}")
    print(f"{last - first} random graphs: {wrong or 'no'} disagreements")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
