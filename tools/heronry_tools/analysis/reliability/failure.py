"""When the graph cannot serve a function any more: its failure as a monotone formula over the elements of a spec.

Resources, placement rules and time are left out here: this is the logic of semantics rules 1 to 6 and 10. An *option*
is a module in one of its modes. An option fails if

    its module cannot be placed     the module or its device is down, or each possible PE is: the PE itself, the place,
                                    or a bus or gateway PE on the one route from the manager's bus. (Between two PEs
                                    that the manager can command there is always a route.)
    its needs cannot hold           a leaf fails if all options fail that give it; a gate that demands k of n inputs
                                    fails if n - k + 1 of them fail, and a XOR like a 1-of-n, since what stands beside
                                    the input that holds is left unwired

and a function fails if all options of its outputs fail.

*Feedback.* Options that feed each other in a cycle carry themselves: what fails is the least solution. A cycle is cut
at some options, whose values are computed again and again, beginning with "nothing fails". With n such options the
values stand still after n rounds, since each round but the last makes at least one of them fail for good.

*What excludes itself.* A module runs in one mode; of the branches of a DEMUX, of its ends, and of the modules on one
actuator at most one runs. Of two options that exclude each other one may be left out if the other feeds all that it
feeds. Where no option stands for the other, there is a choice: the function fails if it fails with every choice.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from heronry_dg.gates import Expression, Leaf, bounds
from heronry_dg.model import Mode, Module, Spec
from heronry_dg.situation import hosts_when_all_is_up, places
from heronry_tools.analysis.reliability.formula import FALSE, TRUE, Formula

_MOST_NODES: Final = 400_000
_SERVES: Final = ("", "", "")  # what an option of an output feeds: the function itself

Option = tuple[str, str]
"""A module and one of its modes."""

_Fed = tuple[str, str, str]  # module, mode, path of the leaf


@dataclass(slots=True)
class Failure:
    """The failure of a function: the node `root` of `formula`.

    reach: the elements that can fail and may matter to the function, with real resources, too; all others do not.
    """

    formula: Formula
    root: int
    reach: frozenset[str] = field(default_factory=frozenset)


def failure(spec: Spec, function: str, elements: Collection[str]) -> Failure:
    """Return the failure of a function, if only these elements can fail.

    spec: as it is in the phase that is meant (`Spec.in_phase`).

    Raises TooLargeError if the choices of what excludes itself make the formula too large.
    """
    return _Compiler(spec, elements).of(function)


class _Compiler:
    def __init__(self, spec: Spec, elements: Collection[str]) -> None:
        self._spec = spec
        self._may_fail = frozenset(elements)
        self._ways: dict[str, frozenset[str]] = {}  # PE -> the elements on its route from the manager's bus
        self._formula = Formula(_MOST_NODES)
        self._givers: dict[str, list[tuple[Option, int]]] = {}
        for module in spec.modules.values():
            if hosts_when_all_is_up(spec, module):
                for mode in module.modes.values():
                    for variable, version in mode.gives.items():
                        self._givers.setdefault(variable, []).append(((module.name, mode.name), version))
        self._pes = self._pe_failures()

    def of(self, function: str) -> Failure:
        outputs = [name for name in self._spec.functions[function].outputs if name in self._spec.modules]
        ends = [(name, mode) for name in outputs for mode in self._spec.modules[name].modes]
        feeds = self._cone(ends)
        choices = _choices(self._spec, feeds)
        values = self._solved({option: self._equation(option, choices) for option in feeds})
        root = self._formula.all_of(values[end] for end in ends)
        for number, values_of in enumerate(choices):
            root = self._chosen(root, number, len(values_of))
        return Failure(self._formula, root, self._reach({module for module, _ in feeds}) & self._may_fail)

    def _reach(self, modules: Iterable[str]) -> frozenset[str]:
        """Return the elements by which modules can be placed, or not."""
        reached: set[str] = set()
        for module in map(self._spec.modules.__getitem__, modules):
            reached |= {f"module:{module.name}", *places(self._spec, module.name)}
            reached |= set() if module.device is None else {f"device:{module.device}"}
            for pe in hosts_when_all_is_up(self._spec, module):
                reached |= self._ways.get(pe, frozenset())
        return frozenset(reached)

    # What an option depends on.

    def _needed(self, option: Option) -> list[tuple[str, Leaf]]:
        """Return the leaves of an option that can decide whether its needs hold."""
        needs = self._spec.modules[option[0]].modes[option[1]].needs
        return [] if needs is None else list(_deciding(needs))

    def _producers(self, option: Option, leaf: Leaf) -> list[Option]:
        """Return the options that can feed a leaf; a module never feeds itself from another mode."""
        return [
            giver
            for giver, version in self._givers.get(leaf.variable, ())
            if leaf.accepts(version) and (giver == option or giver[0] != option[0])
        ]

    def _cone(self, ends: Iterable[Option]) -> dict[Option, set[_Fed]]:
        """Return the options that can matter, each with the leaves that it can feed."""
        feeds: dict[Option, set[_Fed]] = {end: {_SERVES} for end in ends}
        waiting = list(feeds)
        while waiting:
            option = waiting.pop()
            for path, leaf in self._needed(option):
                for giver in self._producers(option, leaf):
                    if giver not in feeds:
                        feeds[giver] = set()
                        waiting.append(giver)
                    feeds[giver].add((*option, path))
        return feeds

    # Elements.

    def _down(self, element: str) -> int:
        return self._formula.event(element) if element in self._may_fail else FALSE

    def _channels(self, bus: str) -> list[str]:
        count = self._spec.buses[bus].channels
        return [f"channel:{bus}.{number}" for number in range(1, count + 1)] if count > 1 else []

    def _bus(self, name: str) -> int:
        channels = [self._down(one) for one in self._channels(name)]
        return self._formula.any_of([self._down(f"bus:{name}"), self._formula.all_of(channels) if channels else FALSE])

    def _pe_failures(self) -> dict[str, int]:
        """Return, for each PE with a route to the manager's bus, the node: it is down, or cannot be commanded."""
        first = self._spec.manager.bus
        found, buses = dict[str, int](), {first: self._bus(first)}
        ways = {first: frozenset((f"bus:{first}", *self._channels(first)))}
        waiting = [first]
        while waiting:
            bus = waiting.pop()
            for pe in self._spec.pes.values():
                if bus not in pe.buses or pe.name in found:
                    continue
                found[pe.name] = self._formula.any_of([buses[bus], self._down(f"pe:{pe.name}")])
                self._ways[pe.name] = ways[bus] | {f"pe:{pe.name}"}
                for other in pe.buses:
                    if other not in buses:
                        buses[other] = self._formula.any_of([found[pe.name], self._bus(other)])
                        ways[other] = self._ways[pe.name] | {f"bus:{other}", *self._channels(other)}
                        waiting.append(other)
        return found

    def _unplaced(self, module: Module) -> int:
        own = set(places(self._spec, module.name))
        hosts = []
        for pe in hosts_when_all_is_up(self._spec, module):
            place = f"module:{module.name}@{pe}"
            hosts.append(self._formula.any_of([self._pes.get(pe, TRUE), self._down(place) if place in own else FALSE]))
        device = [] if module.device is None else [self._down(f"device:{module.device}")]
        return self._formula.any_of([self._down(f"module:{module.name}"), *device, self._formula.all_of(hosts)])

    # Equations, and their least solution.

    def _equation(self, option: Option, choices: "list[list[frozenset[Option]]]") -> "_Equation":
        module = self._spec.modules[option[0]]
        mode = module.modes[option[1]]
        own = [self._unplaced(module)]
        for number, values in enumerate(choices):
            if any(option in chain for chain in values):
                left_out = [_choice(number, index) for index, chain in enumerate(values) if option not in chain]
                own += [self._formula.event(name) for name in left_out]
        producers = {path: self._producers(option, leaf) for path, leaf in self._needed(option)}
        return _Equation(self._formula.any_of(own), mode, producers)

    def _solved(self, equations: "Mapping[Option, _Equation]") -> dict[Option, int]:
        values: dict[Option, int] = {}
        read = {option: dict.fromkeys(equation.read()) for option, equation in equations.items()}  # a fixed order
        for group in _groups(read):
            cut = _cut(group, read)
            ordered = _ordered(group, read, cut)
            values.update(dict.fromkeys(cut, FALSE))
            for _ in cut:
                before = [values[option] for option in cut]
                self._round(equations, ordered, values)
                now = {option: equations[option].value(self._formula, values) for option in cut}
                values.update(now)
                if [values[option] for option in cut] == before:
                    break
            self._round(equations, ordered, values)
        return values

    def _round(
        self, equations: "Mapping[Option, _Equation]", ordered: Iterable[Option], values: dict[Option, int]
    ) -> None:
        for option in ordered:
            values[option] = equations[option].value(self._formula, values)

    # Choices.

    def _chosen(self, root: int, number: int, values: int) -> int:
        """Return the node that is true iff `root` is with every value of a choice, from the least gate that decides."""
        formula = self._formula
        events = [formula.event(_choice(number, index)) for index in range(values)]
        below = set(formula.below(root))
        its = [event for event in events if event in below]
        if not its:
            return root
        gate = _narrowest(formula, root, its)
        made = []
        for value in range(values):
            fixed = {event: TRUE if index == value else FALSE for index, event in enumerate(events)}
            made.append(formula.with_replaced(gate, fixed))
        return formula.with_replaced(root, {gate: formula.all_of(made)})


def _choice(number: int, value: int) -> str:
    """Name the event that choice `number` has this value; no element has such a name."""
    return f"choice {number} {value}"


@dataclass(frozen=True, slots=True)
class _Equation:
    """Why an option fails: `own`, or its needs, of which each leaf fails with all its producers."""

    own: int
    mode: Mode
    producers: Mapping[str, list[Option]]

    def read(self) -> Iterable[Option]:
        return (one for ones in self.producers.values() for one in ones)

    def value(self, formula: Formula, values: Mapping[Option, int]) -> int:
        if self.mode.needs is None:
            return self.own
        leaves = {path: formula.all_of(values[one] for one in ones) for path, ones in self.producers.items()}
        return formula.any_of([self.own, _fails(formula, self.mode.needs, leaves, "")])


def _fails(formula: Formula, needs: Expression, leaves: Mapping[str, int], path: str) -> int:
    if isinstance(needs, Leaf):
        return leaves[path]
    fewest, _ = bounds(needs)
    if fewest == 0:
        return FALSE
    inputs = [_fails(formula, one, leaves, _path(path, index)) for index, one in enumerate(needs.inputs)]
    return formula.at_least(len(inputs) - fewest + 1, inputs)


def _deciding(needs: Expression, path: str = "") -> Iterable[tuple[str, Leaf]]:
    """Return the leaves with their paths, without those below a gate that holds anyway."""
    if isinstance(needs, Leaf):
        yield path, needs
    elif bounds(needs)[0] > 0:
        for index, one in enumerate(needs.inputs):
            yield from _deciding(one, _path(path, index))


def _path(path: str, index: int) -> str:
    return f"{path}.{index}" if path else str(index)


def _choices(spec: Spec, feeds: Mapping[Option, set[_Fed]]) -> list[list[frozenset[Option]]]:
    """Return the choices among options that exclude each other: for each, its values, the options left by each value.

    Options of which one always stands for the other are left together. So most groups leave no choice.
    """
    choices = []
    for modules in _exclusive(spec):
        options = [option for option in feeds if option[0] in modules]
        chains = list(_maximal(options, lambda one, other: _stands_for(feeds, one, other)))
        if len(chains) > 1 and chains not in choices:
            choices.append(chains)
    return choices


def _exclusive(spec: Spec) -> Iterable[frozenset[str]]:
    """Return the groups of modules of which at most one runs, and each other module with several modes as a group."""
    grouped = [frozenset(modules) for demux in spec.demuxes.values() for modules in demux.exclusives.values()]
    grouped += [
        frozenset(module.name for module in spec.modules.values() if module.device == device.name)
        for device in spec.devices.values()
        if device.kind == "actuator"
    ]
    grouped = [group for group in dict.fromkeys(grouped) if len(group) > 1]
    yield from grouped
    covered = frozenset[str]().union(*grouped)
    yield from (
        frozenset({one.name}) for one in spec.modules.values() if len(one.modes) > 1 and one.name not in covered
    )


def _stands_for(feeds: Mapping[Option, set[_Fed]], one: Option, other: Option) -> bool:
    """Tell whether one of two options feeds all that the other feeds, beside that other itself."""

    def covers(this: Option, that: Option) -> bool:
        return {fed for fed in feeds[that] if fed[:2] != that} <= feeds[this]

    return covers(one, other) or covers(other, one)


def _maximal(options: list[Option], alike: Callable[[Option, Option], bool]) -> Iterable[frozenset[Option]]:
    """Return the largest sets of options of which any two are alike (Bron and Kerbosch)."""
    near = {one: {other for other in options if other != one and alike(one, other)} for one in options}
    waiting: list[tuple[frozenset[Option], set[Option], set[Option]]] = [(frozenset(), set(options), set())]
    while waiting:
        chosen, possible, done = waiting.pop()
        if not possible and not done:
            if chosen:
                yield chosen
            continue
        pivot = max(sorted(possible | done), key=lambda one: len(near[one] & possible))
        for one in [one for one in options if one in possible - near[pivot]]:
            waiting.append((chosen | {one}, possible & near[one], done & near[one]))
            possible = possible - {one}
            done = done | {one}


def _groups(read: Mapping[Option, Collection[Option]]) -> list[list[Option]]:
    """Return the groups of options that feed each other, a group after those that it reads (Tarjan)."""
    number: dict[Option, int] = {}
    least: dict[Option, int] = {}
    stack: list[Option] = []
    on_stack: set[Option] = set()
    groups: list[list[Option]] = []
    for start in read:
        if start in number:
            continue
        path = [(start, iter(read[start]))]
        number[start] = least[start] = len(number)
        stack.append(start)
        on_stack.add(start)
        while path:
            option, rest = path[-1]
            following = next(rest, None)
            if following is None:
                path.pop()
                if path:
                    least[path[-1][0]] = min(least[path[-1][0]], least[option])
                if least[option] == number[option]:
                    index = stack.index(option)
                    groups.append(stack[index:])
                    on_stack.difference_update(stack[index:])
                    del stack[index:]
            elif following not in number:
                number[following] = least[following] = len(number)
                stack.append(following)
                on_stack.add(following)
                path.append((following, iter(read[following])))
            elif following in on_stack:
                least[option] = min(least[option], number[following])
    return groups


def _cut(group: list[Option], read: Mapping[Option, Collection[Option]]) -> list[Option]:
    """Return options of a group without which it has no cycle; few, but not always the fewest."""
    left, cut = set(group), list[Option]()
    while True:
        while True:  # what reads nothing of the rest, or is read by nothing of it, is in no cycle
            ends = [one for one in left if not left.intersection(read[one])]
            heard = {other for one in left for other in read[one]}
            ends += [one for one in left if one not in heard]
            if not ends:
                break
            left.difference_update(ends)
        if not left:
            return cut
        readers = {one: sum(one in read[other] for other in left) for one in left}
        worst = max(
            (one for one in group if one in left), key=lambda one: readers[one] * len(left.intersection(read[one]))
        )
        cut.append(worst)
        left.discard(worst)


def _ordered(group: list[Option], read: Mapping[Option, Collection[Option]], cut: Collection[Option]) -> list[Option]:
    """Put the options of a group that are not cut in an order in which each comes after those that it reads."""
    left = {
        one: {other for other in read[one] if other in group and other not in cut} for one in group if one not in cut
    }
    ordered: list[Option] = []
    while left:
        ready = [one for one, before in left.items() if not before]
        ordered += ready
        for one in ready:
            del left[one]
        for before in left.values():
            before.difference_update(ready)
    return ordered


def _narrowest(formula: Formula, root: int, nodes: Collection[int]) -> int:
    """Return the node nearest to some nodes by which every way from `root` to one of them goes."""
    depth, above = {root: 0}, {root: root}

    def joined(one: int, other: int) -> int:
        while one != other:
            if depth[one] < depth[other]:
                one, other = other, one
            one = above[one]
        return one

    for node in reversed(formula.below(root)):
        for one in formula.inputs[node]:
            above[one] = node if one not in above else joined(above[one], node)
        # all readers of a node have larger numbers, so they are done before it
        for one in formula.inputs[node]:
            depth[one] = depth[above[one]] + 1
    found: int | None = None
    for node in nodes:
        found = node if found is None else joined(found, node)
    return root if found is None else found
