"""The candidates: the modules that could serve in a situation, in the modes that could run. The solver gets only these.

The candidates are found in two passes over the spec, both exact:

*Possible.* A mode is possible under two conditions:

- Its module may run on a PE that has room for this mode when nothing else runs there.
- Its `needs` could hold while every other possible mode runs.

Two modules that feed each other are possible together, because feedback is legal. So the pass finds the largest set of
modes that are possible together.

*Useful.* A module is useful in two cases; no other module can serve (semantics rule 5):

- It is the output of a wanted function (priority above 0 in the phase). If the output is a DEMUX, its ends are useful.
- It feeds a possible mode of a useful module.

Every legal configuration consists of candidates. Sums (resources, traffic) are not checked here: the solver does that.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from heronry_dg.gates import Leaf, could_hold
from heronry_dg.model import Mode, Module, Spec
from heronry_dg.situation import Situation, Survivors, survivors


@dataclass(frozen=True, slots=True)
class Source:
    """A producer to which a leaf could be wired: a module, in any of `modes`, which all give the same version."""

    module: str
    version: int
    modes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A module that may run in this situation, with the PEs that could carry each of its possible modes."""

    module: Module
    hosts: Mapping[str, tuple[str, ...]]  # possible mode -> PEs, both in the spec's order

    def modes(self) -> Iterator[Mode]:
        """Return the possible modes, best first."""
        return (self.module.modes[name] for name in self.hosts)

    def pes(self) -> tuple[str, ...]:
        """Return the PEs that could carry the module in at least one of its possible modes."""
        return tuple(dict.fromkeys(pe for hosts in self.hosts.values() for pe in hosts))


@dataclass(frozen=True, slots=True)
class Candidates:
    """All modules that may run in a situation and serve a wanted function, directly or through others."""

    spec: Spec
    now: Situation
    left: Survivors
    wanted: frozenset[str]  # modules that serve by running: outputs of wanted functions
    modules: Mapping[str, Candidate]
    givers: Mapping[str, Sequence[tuple[str, str, int]]]  # variable -> (module, mode, version), in the spec's order

    def sources(self, consumer: str, mode: str, leaf: Leaf) -> tuple[Source, ...]:
        """List the producers to which a leaf could be wired, one for each module and version, in the spec's order."""
        found: dict[tuple[str, int], list[str]] = {}
        for module, giving, version in self.givers.get(leaf.variable, ()):
            feeds_itself = module == consumer  # possible only in the same mode, since it runs in one
            if leaf.accepts(version) and (giving == mode or not feeds_itself):
                found.setdefault((module, version), []).append(giving)
        return tuple(Source(module, version, tuple(modes)) for (module, version), modes in found.items())


def candidates(spec: Spec, now: Situation) -> Candidates:
    """Find the modules that may run in a situation and are useful in it."""
    spec, left = spec.in_phase(now.phase), survivors(spec, now)
    wanted = frozenset(m for f in spec.functions.values() if now.priority_of(f) > 0 for m in f.outputs)
    possible = _possible(_placeable(spec, left))
    useful = _useful(possible, wanted)
    modules = {name: candidate for name, candidate in possible.items() if name in useful}
    return Candidates(spec, now, left, wanted, modules, _givers(modules))


def _givers(modules: Mapping[str, Candidate]) -> dict[str, list[tuple[str, str, int]]]:
    givers: dict[str, list[tuple[str, str, int]]] = {}
    for name, candidate in modules.items():
        for mode in candidate.modes():
            for variable, version in mode.gives.items():
                givers.setdefault(variable, []).append((name, mode.name, version))
    return givers


def _placeable(spec: Spec, left: Survivors) -> dict[str, Candidate]:
    """Return the modules that fit on some PE, with the PEs that could carry each mode if nothing else ran there."""
    placeable = {}
    for module in spec.modules.values():
        pes = [pe for pe in left.hosts(module) if module.flash <= spec.pes[pe].flash]
        hosts = {
            mode.name: tuple(
                pe for pe in pes if mode.cpu_millis <= left.pe_cpu_millis[pe] and mode.ram <= spec.pes[pe].ram
            )
            for mode in module.modes.values()
        }
        hosts = {mode: fitting for mode, fitting in hosts.items() if fitting}
        if hosts:
            placeable[module.name] = Candidate(module, hosts)
    return placeable


def _possible(placeable: dict[str, Candidate]) -> dict[str, Candidate]:
    """Remove the modes whose `needs` cannot hold with the modes that are left; repeat this until no mode is removed."""
    current = placeable
    while True:
        given = _given(current)
        kept = {name: _with_needs_met(candidate, given) for name, candidate in current.items()}
        kept = {name: candidate for name, candidate in kept.items() if candidate.hosts}
        if kept == current:
            return current
        current = kept


def _given(modules: Mapping[str, Candidate]) -> dict[str, set[int]]:
    """Return, for each variable, the versions in which possible modes give the variable."""
    given: dict[str, set[int]] = {}
    for candidate in modules.values():
        for mode in candidate.modes():
            for variable, version in mode.gives.items():
                given.setdefault(variable, set()).add(version)
    return given


def _with_needs_met(candidate: Candidate, given: Mapping[str, set[int]]) -> Candidate:
    def is_given(leaf: Leaf) -> bool:
        return any(map(leaf.accepts, given.get(leaf.variable, ())))

    hosts = {
        mode.name: candidate.hosts[mode.name]
        for mode in candidate.modes()
        if mode.needs is None or could_hold(mode.needs, is_given)
    }
    return Candidate(candidate.module, hosts)


def _useful(possible: Mapping[str, Candidate], wanted: frozenset[str]) -> set[str]:
    """Return the modules in `wanted`, and all that feed a possible mode of one of these, directly or not."""
    givers = _givers(possible)
    useful = {name for name in possible if name in wanted}
    frontier = list(useful)
    while frontier:
        for mode in possible[frontier.pop()].modes():
            for _, leaf in mode.leaves():
                for name, _, version in givers.get(leaf.variable, ()):
                    if name not in useful and leaf.accepts(version):
                        useful.add(name)
                        frontier.append(name)
    return useful
