"""A lower bound of the data that must cross the buses so that certain functions are served, in any plan.

A function needs one of its output modules. So it certainly needs each variable that all its output modules
need in all their modes. Such a variable must come from one of its *givers*, the modules that can give it. So
each variable that all these givers need in all their modes is certainly needed as well, and so on.

If no giver of a variable can share a PE with a reader of the variable, the variable must be published. The
variable then crosses every bus that lies on all routes from a giver to a reader. Its rate there is at least
the lowest rate of the givers. The rates on a bus may be added, because each variable is counted once.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce

from heronry_dg.gates import Expression, Leaf, bounds
from heronry_dg.model import Spec
from heronry_dg.traffic import frame_bits
from heronry_manager.planner.candidates import Candidates

_Versions = tuple[int, int]  # best and worst version that serves


@dataclass(slots=True)
class ForcedTraffic:
    """The lowest rates at which variables must be published.

    rates: by bus, then by variable: the rate in millihertz.
    """

    spec: Spec
    rates: dict[str, dict[str, int]] = field(default_factory=dict)

    def mbit_per_s(self, bus: str) -> dict[str, int]:
        """Bandwidth of each variable on a bus at its rate in `rates`, in thousandths of a bit/s."""
        return {name: frame_bits(self.spec, name) * rate for name, rate in self.rates.get(bus, {}).items()}

    def overloaded(self, capacities: Mapping[str, int]) -> Iterator[str]:
        """Name the buses whose forced traffic exceeds their capacity.

        capacities: the capacity of each bus, in thousandths of a bit/s.
        """
        yield from (bus for bus in self.rates if sum(self.mbit_per_s(bus).values()) > capacities[bus])


def forced_traffic(possible: Candidates) -> ForcedTraffic:
    """Work out what a plan must publish at least if it serves all functions of `possible` that can be served."""
    found = ForcedTraffic(possible.spec)
    outputs = (
        frozenset(one for one in function.outputs if one in possible.modules)
        for function in possible.spec.functions.values()
    )
    frontier = [readers for readers in outputs if readers]
    seen = set(frontier)
    while frontier:
        readers = frontier.pop()
        for variable, versions in _needed_by_all(possible, readers).items():
            givers = {
                (module, mode)
                for module, mode, version in possible.givers.get(variable, ())
                if versions[0] <= version <= versions[1]
            }
            _publish(possible, found, variable, givers, readers)
            names = frozenset(module for module, _ in givers)
            if names and names not in seen:
                seen.add(names)
                frontier.append(names)
    return found


def _publish(
    possible: Candidates, found: ForcedTraffic, variable: str, givers: set[tuple[str, str]], readers: frozenset[str]
) -> None:
    """Add a variable to `found`, on each bus that every route from a giver to a reader takes.

    The routes are those between any PE of any giver and any PE of any reader; without a route nothing is added.

    givers: (module, mode) pairs that give the variable; the lowest of their rates counts.
    readers: modules that read the variable.
    """
    ways = [
        frozenset(possible.left.route(here, there) or ())
        for here in {pe for module, _ in givers for pe in possible.modules[module].pes()}
        for there in {pe for reader in readers for pe in possible.modules[reader].pes()}
    ]
    if not ways:
        return
    rate = min(possible.spec.modules[module].modes[mode].rate_mhz for module, mode in givers)
    for bus in sorted(frozenset.intersection(*ways)):
        rates = found.rates.setdefault(bus, {})
        rates[variable] = max(rate, rates.get(variable, 0))


def _needed_by_all(possible: Candidates, readers: frozenset[str]) -> dict[str, _Versions]:
    """Return what all possible modes of all these modules need, with the best and worst version that any accepts."""
    every = [_needed(mode.needs) for name in sorted(readers) for mode in possible.modules[name].modes()]
    return reduce(_both, every)


def _needed(needs: Expression | None) -> dict[str, _Versions]:
    """Return the variables without which a gate expression cannot hold.

    Each has the best and the worst version that the expression accepts.
    """
    if needs is None:
        return {}
    if isinstance(needs, Leaf):
        return {needs.variable: (needs.best, needs.worst)}
    fewest, _ = bounds(needs)
    each = [_needed(one) for one in needs.inputs]
    counts: dict[str, int] = {}
    for variable in (name for one in each for name in one):
        counts[variable] = counts.get(variable, 0) + 1
    return {
        variable: _hull([one[variable] for one in each if variable in one])
        for variable, count in counts.items()
        if len(each) - count < fewest
    }


def _both(one: dict[str, _Versions], other: dict[str, _Versions]) -> dict[str, _Versions]:
    return {variable: _hull([one[variable], other[variable]]) for variable in one if variable in other}


def _hull(versions: list[_Versions]) -> _Versions:
    return min(best for best, _ in versions), max(worst for _, worst in versions)
