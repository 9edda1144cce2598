"""The objective for the solver: the levels of docs/semantics.md, section 4, as weighted sums of literals.

A level is a weighted sum of literals (Boolean variables of the solver, or their negations). Its bounds follow from its
own terms alone. More is always better: a quantity that should be small is negated.

Neighbouring levels of one kind form a *group*, and are solved together as one weighted sum. This is exact, since the
weight of each level is greater than the greatest sum of all later levels of the group. If the weighted sum of a group
would not fit 62 bits, the group is divided. The kinds were chosen so that the levels of a group are solved fast
together:

    serving    levels 1 and 2, critical classes and utility. As a rule all functions can be served, and then no search
               is needed
    supplying  levels 3 to 5, inputs, changes and branches. For the solver this is a packing problem, in which the
               linear relaxation gives good bounds
    thrift     levels 6 and 7, bandwidth and CPU. For the solver this is the partitioning of a graph in which most
               modules have their places already; the linear relaxation gives good bounds here, too
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from itertools import groupby

from heronry_dg.gates import most_points
from heronry_dg.model import Mode
from heronry_dg.objective import CRITICAL_CLASSES, Placement
from heronry_manager.planner.candidates import Candidates
from heronry_manager.planner.placing import Choice, Placing, Terms
from heronry_manager.planner.publishing import Publishing
from heronry_manager.planner.wiring import Wiring

_SAFE = 2**62


class Kind(Enum):
    """The kind of problem that a level poses to the solver; the kind decides which searches are used."""

    SERVING = auto()
    SUPPLYING = auto()
    THRIFT = auto()


@dataclass(frozen=True, slots=True)
class Level:
    """A quantity to maximise: the sum of `terms`, which lies in `low`..`high`.

    In the key of an objective, the level stands at the index `position`: `Objective.key()[position]` is the
    sum of `terms` plus `offset`.
    """

    position: int
    kind: Kind
    terms: Terms
    low: int
    high: int
    offset: int = 0

    def value(self, key: Sequence[int]) -> int:
        """Return the sum of this level's terms in a configuration whose objective has the key `key`."""
        return key[self.position] - self.offset


def level_groups(
    placing: Placing, wiring: Wiring, publishing: Publishing, running: Placement | None
) -> list[list[Level]]:
    """Return the levels whose value can vary, the most important first, in groups that are solved together."""
    possible = placing.possible
    levels = [
        *serving_levels(placing),
        _inputs(possible, wiring),
        _changes(placing, running),
        _branches(possible, placing),
        _bandwidth(publishing),
        _cpu(possible, placing),
    ]
    can_differ = (level for level in levels if level.low < level.high)
    kinds = groupby(can_differ, key=lambda level: level.kind)
    return [part for _, group in kinds for part in _that_fit(group)]


def serving_levels(choice: Choice) -> list[Level]:
    """Return levels 1 and 2, which do not depend on where modules run."""
    return [*_critical(choice), _utility(choice)]


def merged(group: list[Level]) -> Terms:
    """Return one weighted sum of a group: a greater sum means better at the first level that differs."""
    weights = zip(_weights(group), group, strict=True)
    return [(literal, weight * worth) for weight, level in weights for literal, worth in level.terms]


def bounds_of(group: list[Level], bound: int, key: Sequence[int]) -> Iterator[int]:
    """Yield an upper bound for each level of a group, in the order of the levels.

    bound: upper bound on the merged sum of the group (`merged`).
    key: the key of the best configuration found so far.

    The bound of a level holds for all configurations that are no worse than `key` at the levels before it. A
    level is proven if its bound equals its value in `key`. Once a level is not proven, the merged sum says
    nothing about the levels after it: their bounds are their own `high`.
    """
    weights = _weights(group)
    room = bound - sum(weight * level.low for weight, level in zip(weights, group, strict=True))
    proven = True
    for weight, level in zip(weights, group, strict=True):
        most = min(level.low + room // weight, level.high) if proven else level.high
        yield most
        proven &= most == level.value(key)
        room -= weight * (most - level.low)


def _weights(group: list[Level]) -> list[int]:
    weight, weights = 1, []
    for level in reversed(group):
        weights.append(weight)
        weight *= level.high - level.low + 1
    return weights[::-1]


def _that_fit(group: Iterable[Level]) -> Iterator[list[Level]]:
    """Divide a group of levels, in order, into smaller groups.

    The weighted sum into which the levels of a smaller group are merged (`merged`) fits into 62 bits.
    """
    part: list[Level] = []
    for level in group:
        if part and sum(abs(weight) for _, weight in merged([*part, level])) >= _SAFE:
            yield part
            part = []
        part.append(level)
    if part:
        yield part


def _level(position: int, kind: Kind, alternatives: Iterable[Terms], offset: int = 0) -> Level:
    """Make a level from lists of alternative terms; in each list, at most one term can be true.

    position: place of the level in `Objective.key()`.
    offset: the number at this place of the key is the sum of the terms plus `offset`.
    """
    groups = [group for group in alternatives if group]
    return Level(
        position,
        kind,
        terms=[(literal, worth) for group in groups for literal, worth in group if worth],
        low=sum(min((0, *(worth for _, worth in group))) for group in groups),
        high=sum(max((0, *(worth for _, worth in group))) for group in groups),
        offset=offset,
    )


def _critical(choice: Choice) -> Iterator[Level]:
    possible = choice.possible
    for position, criticality in enumerate(CRITICAL_CLASSES):
        functions = [f for f in possible.spec.functions.values() if f.criticality_in(possible.now.phase) == criticality]
        yield _level(
            position,
            Kind.SERVING,
            (
                [(choice.runs[output], possible.now.priority_of(f)) for output in f.outputs if output in choice.runs]
                for f in functions
            ),
        )


def _utility(choice: Choice) -> Level:
    possible = choice.possible
    functions = []
    for function in possible.spec.functions.values():
        priority = possible.now.priority_of(function)
        served: Terms = []
        for name in function.outputs if priority else ():
            if name in possible.modules:
                module = possible.modules[name].module
                served.extend(
                    (choice.on[name, mode], priority * function.value_of(module.mode_index(mode), len(module.modes)))
                    for mode in possible.modules[name].hosts
                )
        functions.append(served)
    return _level(4, Kind.SERVING, functions)


def _inputs(possible: Candidates, wiring: Wiring) -> Level:
    worths = {
        where: [(literal, leaf.points(source.version)) for source, leaf, literal in wires]
        for where, wires in wiring.wires.items()
    }
    sums = _level(5, Kind.SUPPLYING, worths.values())
    highest = {where: max((0, *(worth for _, worth in group))) for where, group in worths.items()}
    most = {
        name: max(_most_of(mode, name, highest) for mode in candidate.modes())
        for name, candidate in possible.modules.items()
    }
    return replace(sums, high=sum(most.values()) - sum(_idle_branches(possible, most)))


def _idle_branches(possible: Candidates, most: Mapping[str, int]) -> Iterator[int]:
    """Yield, for each group of modules of which only one can run, the points of all its modules but the best one.

    No configuration can have these points, so the caller subtracts them from the sum of `most`. The branches of a
    DEMUX are a group, and so are its ends and the drivers of one actuator. A module in several groups counts only in
    the first one.

    most: by name of a module, the most points that its inputs can have.
    """
    counted: set[str] = set()
    for rivals in possible.spec.rivals():
        points = [most[module] for module in rivals if module in most and module not in counted]
        yield sum(points) - max(points, default=0)
        counted.update(rivals)


def _most_of(mode: Mode, module: str, highest: Mapping[tuple[str, str, str], int]) -> int:
    """Return the most points that the inputs of a mode can have together.

    highest: by (module, mode, path of a leaf), the most points of this leaf.
    """
    return most_points(mode.needs, lambda _, path: highest.get((module, mode.name, path), 0))


def _changes(placing: Placing, running: Placement | None) -> Level:
    """Make the level of changes: minus the number of modules that change; an empty level if `running` is None.

    The offset of the level is minus the number of running modules. Each module that stays in its mode on its PE
    adds 1 to the level, and each new module subtracts 1. A running module that cannot stay has no term, since
    its change cannot be avoided.
    """
    if running is None:
        return _level(6, Kind.SUPPLYING, ())
    alternatives: list[Terms] = []
    for name, literal in placing.runs.items():
        if name not in running:
            alternatives.append([(literal, -1)])
        elif (stays := placing.x.get((name, *running[name]))) is not None:
            alternatives.append([(stays, 1)])
    return _level(6, Kind.SUPPLYING, alternatives, offset=-len(running))


def _branches(possible: Candidates, placing: Placing) -> Level:
    return _level(
        7,
        Kind.SUPPLYING,
        (
            [(placing.runs[end], -i) for i, end in enumerate(demux.ends) if end in placing.runs]
            for demux in possible.spec.demuxes.values()
        ),
    )


def _bandwidth(publishing: Publishing) -> Level:
    terms = (term for terms in publishing.bandwidth.values() for term in terms)
    return _level(8, Kind.THRIFT, ([(literal, -weight)] for literal, weight in terms))


def _cpu(possible: Candidates, placing: Placing) -> Level:
    return _level(
        9,
        Kind.THRIFT,
        (
            [(placing.on[name, mode.name], -mode.cpu_millis) for mode in candidate.modes()]
            for name, candidate in possible.modules.items()
        ),
    )
