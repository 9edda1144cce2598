"""The part of the solver's model that says which source is published on which bus, and with how much bandwidth.

The buses form a forest over the PEs. If one bus is taken away, the PEs fall into groups, the *sides* of this bus. By
semantics rule 7, a source is published on a bus if and only if a consumer that is wired to the source is on another
side than the producer. The number of such consumers does not matter.

The constraints demand only one direction: a source that is needed on a bus is published there. The solver may publish a
source without need, but no plan gets better by this. So the optimum is exact.

The bandwidth depends on the rate of the producer's mode. If the modes of a producer differ in rate, the model has one
literal for each rate. `heronry_manager.planner.deadlines` adds the deadlines (semantics rule 9) where they matter.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise

from heronry_dg.checkpoints import carriers, frames_mbit_per_s
from heronry_dg.situation import Survivors
from heronry_dg.traffic import Hop, source_mbit_per_s
from heronry_manager.planner.candidates import Candidates
from heronry_manager.planner.cp_sat import CpModel, IntVar, LinearExpr
from heronry_manager.planner.placing import Placing, Terms, weighted
from heronry_manager.planner.wiring import Link, Wiring

Side = frozenset[str]  # PEs that stay connected when a bus is taken away
MessageKey = tuple[str, str, int, str]  # producer, variable, rate in mHz, bus


class Publishing:
    """The variables of the solver's model that say which source is published on which bus."""

    def __init__(self, model: CpModel, possible: Candidates, placing: Placing, wiring: Wiring) -> None:
        """Add the variables that say what is published on which bus, and limit the bandwidth of each bus.

        The limit is that of semantics rule 7.
        """
        self.bandwidth: dict[str, Terms] = {bus: [] for bus in possible.left.bus_mbit_per_s}  # mbit/s
        self._model = model
        self._possible = possible
        self._placing = placing
        self._modes: dict[MessageKey, str] = {}  # one of the producer's modes that have the rate
        self._published: dict[tuple[str, str, str], IntVar] = {}  # producer, variable, bus
        self.messages: dict[MessageKey, IntVar] = {}
        sides = {bus: _sides(possible.left, bus) for bus in self.bandwidth}
        for link, literals in wiring.links.items():
            for bus, parts in sides.items():
                self._publish(link, literals, bus, parts)
        self._split_by_rate()
        kept = self._checkpoints()
        for bus, published in self.bandwidth.items():
            terms = [*published, *kept.get(bus, ())]
            if sum(weight for _, weight in terms) > possible.left.bus_mbit_per_s[bus]:
                model.add(weighted(terms) <= possible.left.bus_mbit_per_s[bus])

    def forbid_together(self, hops: Iterable[Hop]) -> None:
        """Add a constraint: not all of these hops are published together.

        - For a hop with a previous bus (`hop.after`), the constraint holds only if the data come over that bus.
        - For a hop without a previous bus, the constraint holds wherever the data come from. This is safe: a message
          that has crossed other buses has more jitter, and never comes earlier.
        """
        taken: list[IntVar] = []
        facts = 0
        for hop in sorted(hops, key=lambda hop: (hop.bus, hop.producer, hop.variable)):
            taken.append(self.messages[self.key(hop)])
            facts += 1
            there = self._comes_from(hop)
            if there is not None:
                taken.extend(there)
                facts += 1
        self._model.add(LinearExpr.sum(taken) <= facts - 1)

    def one_of(self, literals: Iterable[IntVar], hop: Hop) -> None:
        """Add a constraint: if a hop is published, at least one of these literals is true.

        For a hop with a previous bus (`hop.after`), the constraint holds only if the data come over that bus.
        """
        elsewhere = [self.messages[self.key(hop)].negated(), *literals]
        there = self._comes_from(hop)
        for origin in [None] if there is None else there:
            self._model.add_bool_or([*elsewhere, *([] if origin is None else [origin.negated()])])

    def more_urgent(self, hop: Hop, identifiers: Mapping[tuple[str, str], int]) -> Iterator[tuple[MessageKey, Hop]]:
        """Yield all messages that are sent on the same bus as the message of `hop`, and are more urgent than it.

        Each is given as its key and a hop that stands for it; this hop names no bus before (its `after` is None).

        identifiers: identifier of each (producing module, variable); the lower one is more urgent.
        """
        own = identifiers[hop.producer, hop.variable]
        for key in self.messages:
            producer, variable, _, bus = key
            if bus == hop.bus and identifiers[producer, variable] < own:
                yield key, Hop(producer, variable, self._modes[key], bus)

    def key(self, hop: Hop) -> MessageKey:
        """Return the key that names the message of a hop in the model."""
        rate_mhz = self._possible.spec.modules[hop.producer].modes[hop.mode].rate_mhz
        return hop.producer, hop.variable, rate_mhz, hop.bus

    def _comes_from(self, hop: Hop) -> list[IntVar] | None:
        """Return literals that tell whether the data of a hop come to its bus from the bus `hop.after`.

        If the data come from that bus, exactly one literal is true, otherwise none.
        None: `hop.after` is None, or the data come from that bus wherever the producer runs.
        """
        if hop.after is None:
            return None
        return self._placing.somewhere(hop.producer, _origins(self._possible.left, hop.after, hop.bus))

    def hint(self, published: Iterable[Hop]) -> Iterator[tuple[IntVar, bool]]:
        """Yield each variable with the value that it has if exactly these hops are published."""
        rates = {
            (hop.producer, hop.variable, hop.bus): self._possible.spec.modules[hop.producer].modes[hop.mode].rate_mhz
            for hop in published
        }
        for key, literal in self._published.items():
            yield literal, key in rates
        for (producer, variable, rate_mhz, bus), literal in self.messages.items():
            yield literal, rates.get((producer, variable, bus)) == rate_mhz

    def _publish(self, link: Link, literals: list[IntVar], bus: str, sides: list[Side]) -> None:
        """Add constraints: if a link leads from one side of `bus` to another side, its source is published on `bus`.

        link: consumer, producer, variable.
        literals: the possible wires of the link; one is true if the link is wired, and none if not.
        sides: all sides of `bus`, each as the PEs on it.
        """
        consumer, producer, variable = link
        if consumer == producer:
            return
        linked = LinearExpr.sum(literals)
        for bound, free in ((consumer, producer), (producer, consumer)):
            home = self._only_side(bound, sides)
            if home is not None:
                with_it = self._placing.somewhere(free, home)
                if with_it is not None:
                    published = self._publication(producer, variable, bus)
                    self._model.add(published >= linked - LinearExpr.sum(with_it))
                return
        published = self._publication(producer, variable, bus)
        for side in sides:
            at_producer = LinearExpr.sum(self._placing.somewhere(producer, side) or [])
            at_consumer = LinearExpr.sum(self._placing.somewhere(consumer, side) or [])
            self._model.add(published >= linked + at_producer - at_consumer - 1)

    def _only_side(self, module: str, sides: list[Side]) -> Side | None:
        """Return which of all sides of the bus (see head) has all possible PEs of a module; None: several."""
        return next((side for side in sides if side.issuperset(self._placing.pes[module])), None)

    def _publication(self, producer: str, variable: str, bus: str) -> IntVar:
        key = (producer, variable, bus)
        if key not in self._published:
            self._published[key] = self._model.new_bool_var(f"{producer}:{variable} on {bus}")
        return self._published[key]

    def _split_by_rate(self) -> None:
        for (producer, variable, bus), published in self._published.items():
            rates = self._rates(producer, variable)
            for rate_mhz, modes in rates.items():
                message = published
                if len(rates) > 1:
                    message = self._model.new_bool_var(f"{producer}:{variable} on {bus} at {rate_mhz} mHz")
                    running = LinearExpr.sum(self._placing.in_modes(producer, modes))
                    self._model.add(message >= published + running - 1)
                self.messages[producer, variable, rate_mhz, bus] = message
                self._modes[producer, variable, rate_mhz, bus] = modes[0]
                mode = self._possible.spec.modules[producer].modes[modes[0]]
                weight = source_mbit_per_s(self._possible.spec, variable, mode)
                self.bandwidth[bus].append((message, weight))

    def _checkpoints(self) -> dict[str, Terms]:
        """Return what checkpoints add to the load of each bus; levels do not count it, so it is not in `bandwidth`."""
        left, kept = self._possible.left, dict[str, Terms]()
        for (name, pe), literal in self._placing.at.items():
            module = left.spec.modules[name]
            if module.checkpoint is not None:
                for bus in carriers(left, module, pe):
                    kept.setdefault(bus, []).append((literal, frames_mbit_per_s(module.checkpoint)))
        return kept

    def _rates(self, producer: str, variable: str) -> Mapping[int, list[str]]:
        rates: dict[int, list[str]] = {}
        for mode in self._possible.modules[producer].modes():
            if variable in mode.gives:
                rates.setdefault(mode.rate_mhz, []).append(mode.name)
        return rates


def _sides(left: Survivors, bus: str) -> list[Side]:
    """Return the sides of a bus: the sets of PEs that are up and reach one another by routes without this bus."""
    sides: dict[Side, None] = {}
    for pe in left.pe_cpu_millis:
        sides[frozenset(other for other in left.pe_cpu_millis if bus not in (left.route(pe, other) or ()))] = None
    return list(sides)


def _origins(left: Survivors, first: str, then: str) -> set[str]:
    """Return the PEs from which some route leads over the bus `first` and directly on to the bus `then`."""
    return {origin for (origin, _), route in left.routes.items() if (first, then) in pairwise(route)}
