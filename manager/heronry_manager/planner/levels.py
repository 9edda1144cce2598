"""Which legal configuration is best, as the solver sees it: the levels of semantics.md section 4.

A level is a weighted sum of literals with bounds that follow from its own terms alone. It is kept as "more is better":
what should be small is negated. Neighbouring levels are solved as one where a weighted sum of them is exact: each
level's weight is greater than all that the levels below it can add up to. The groups are those that were found fast
together (critical classes with utility; inputs, changes and branches; bandwidth and CPU), cut where a weighted sum
would not fit 62 bits.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from heronry_dg.gates import Expression, Leaf, Xor, child_path
from heronry_dg.objective import CRITICAL_CLASSES, Placement
from heronry_manager.planner.candidates import Candidates
from heronry_manager.planner.placing import Placing, Terms
from heronry_manager.planner.publishing import Publishing
from heronry_manager.planner.wiring import Wiring

_SAFE = 2**62


@dataclass(frozen=True, slots=True)
class Level:
    """A quantity to maximise: the sum of `terms`, which lies in `low`..`high`."""

    name: str
    terms: Terms
    low: int
    high: int


def level_groups(
    placing: Placing, wiring: Wiring, publishing: Publishing, running: Placement | None
) -> list[list[Level]]:
    """All levels, most important first, in the groups that are solved together."""
    possible = placing.possible
    planned = [
        [*_critical(possible, placing), _utility(possible, placing)],
        [_inputs(possible, wiring), _changes(placing, running), _branches(possible, placing)],
        [_bandwidth(publishing), _cpu(possible, placing)],
    ]
    return [part for group in planned for part in _that_fit(group)]


def merged(group: list[Level]) -> Terms:
    """One sum that compares as the levels of a group do in their order."""
    weight = 1
    terms: Terms = []
    for level in reversed(group):
        terms.extend((literal, weight * worth) for literal, worth in level.terms)
        weight *= level.high - level.low + 1
    return terms


def _that_fit(group: list[Level]) -> Iterator[list[Level]]:
    """Cut a group where its merged sum would leave 62 bits; levels that cannot differ are left out."""
    part: list[Level] = []
    for level in group:
        if level.low == level.high:
            continue
        if part and sum(abs(weight) for _, weight in merged([*part, level])) >= _SAFE:
            yield part
            part = []
        part.append(level)
    if part:
        yield part


def _level(name: str, alternatives: Iterable[Terms]) -> Level:
    """Sum up terms, of which at most one out of each list of alternatives is taken."""
    groups = [group for group in alternatives if group]
    return Level(
        name=name,
        terms=[(literal, worth) for group in groups for literal, worth in group if worth],
        low=sum(min((0, *(worth for _, worth in group))) for group in groups),
        high=sum(max((0, *(worth for _, worth in group))) for group in groups),
    )


def _critical(possible: Candidates, placing: Placing) -> Iterator[Level]:
    for criticality in CRITICAL_CLASSES:
        functions = [f for f in possible.spec.functions.values() if f.criticality_in(possible.phase) == criticality]
        yield _level(
            f"critical {criticality}",
            (
                [
                    (placing.runs[output], f.priority_in(possible.phase))
                    for output in f.outputs
                    if output in placing.runs
                ]
                for f in functions
            ),
        )


def _utility(possible: Candidates, placing: Placing) -> Level:
    functions = []
    for function in possible.spec.functions.values():
        priority = function.priority_in(possible.phase)
        served: Terms = []
        for name in function.outputs if priority else ():
            if name in possible.modules:
                module = possible.modules[name].module
                served.extend(
                    (placing.on[name, mode], priority * function.value_of(module.mode_index(mode), len(module.modes)))
                    for mode in possible.modules[name].hosts
                )
        functions.append(served)
    return _level("utility", functions)


def _inputs(possible: Candidates, wiring: Wiring) -> Level:
    worths = {
        where: [(literal, leaf.points(source.version)) for source, leaf, literal in wires]
        for where, wires in wiring.wires.items()
    }
    sums = _level("inputs", worths.values())
    highest = {where: max((0, *(worth for _, worth in group))) for where, group in worths.items()}
    high = sum(
        max(_most(mode.needs, (name, mode.name, ""), highest) for mode in candidate.modes())
        for name, candidate in possible.modules.items()
    )
    return Level(sums.name, sums.terms, sums.low, high)


def _most(gate: Expression | None, where: tuple[str, str, str], highest: Mapping[tuple[str, str, str], int]) -> int:
    """Most points that the leaves of a gate can have together."""
    if gate is None or isinstance(gate, Leaf):
        return highest.get(where, 0)
    children = [
        _most(child, (where[0], where[1], child_path(where[2], index)), highest)
        for index, child in enumerate(gate.inputs)
    ]
    return max(children) if isinstance(gate, Xor) else sum(children)


def _changes(placing: Placing, running: Placement | None) -> Level:
    """Negated changes, less those that no plan can avoid: stopping what cannot run on."""
    if running is None:
        return _level("changes", ())
    alternatives: list[Terms] = []
    for name, literal in placing.runs.items():
        if name not in running:
            alternatives.append([(literal, -1)])
        elif (stays := placing.x.get((name, *running[name]))) is not None:
            alternatives.append([(stays, 1)])
    return _level("changes", alternatives)


def _branches(possible: Candidates, placing: Placing) -> Level:
    return _level(
        "branches",
        (
            [(placing.runs[branch], -i) for i, branch in enumerate(demux.branches) if branch in placing.runs]
            for demux in possible.spec.demuxes.values()
        ),
    )


def _bandwidth(publishing: Publishing) -> Level:
    terms = (term for terms in publishing.bandwidth.values() for term in terms)
    return _level("bandwidth", ([(literal, -weight)] for literal, weight in terms))


def _cpu(possible: Candidates, placing: Placing) -> Level:
    return _level(
        "cpu",
        (
            [(placing.on[name, mode.name], -mode.cpu_millis) for mode in candidate.modes()]
            for name, candidate in possible.modules.items()
        ),
    )
