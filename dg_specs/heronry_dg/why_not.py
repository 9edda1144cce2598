"""Explains in one sentence why a function is not served: the root cause, found without a solver.

First, the file computes what could run with unlimited resources. This is the greatest set of (module, mode) that meets
two conditions:

- each module of the set has a PE to run on;
- the needs of each mode of the set can be met by modes of the set.

The computation starts from all modes, and removes impossible modes round by round. So modules that feed one another in
a cycle remain in the set.

If the set lacks the output of a function, the cause can be traced to a fault. If the set has the output, the function
was left out for one of two causes: for lack of resources, or in favour of other functions. A planner that has found out
which of these two causes holds passes the answer to `why_not` as `alone`.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from heronry_dg.findings import listed
from heronry_dg.gates import Expression, Leaf, could_hold
from heronry_dg.model import Function, Mode, Module, Spec
from heronry_dg.situation import Situation, Survivors, hosts_when_all_is_up, survivors

_NAMED_ALTERNATIVES = 2


@dataclass(frozen=True, slots=True)
class Feasible:
    """Tells which modes of the spec's modules could run in one situation if resources were unlimited.

    For each of the other modes it has the round of the computation in which the mode was removed as impossible.
    """

    spec: Spec
    now: Situation
    left: Survivors
    lost: dict[tuple[str, str], int]  # (module, mode) that cannot run -> round in which it was removed; 0: it has no PE
    producers: Mapping[str, Sequence[tuple[Module, Mode]]]  # of each variable, in the spec's order

    def can_run(self, module: Module) -> bool:
        """Tell whether a module could run in at least one of its modes if resources were unlimited."""
        return any((module.name, mode) not in self.lost for mode in module.modes)

    def givers(self, leaf: Leaf) -> Iterator[tuple[Module, Mode]]:
        """Yield every (module, mode) that gives a version accepted by a leaf, even if the mode cannot run."""
        for module, mode in self.producers[leaf.variable]:
            if leaf.accepts(mode.gives[leaf.variable]):
                yield module, mode

    def can_hold(self, needs: Expression | None, before: int) -> bool:
        """Tell whether an expression could be met with the modes left when round `before` began (`Feasibility`)."""
        return needs is None or could_hold(needs, lambda leaf: self._could_be_given(leaf, before))

    def _could_be_given(self, leaf: Leaf, before: int) -> bool:
        lost = (self.lost.get((module.name, mode.name), before) for module, mode in self.givers(leaf))
        return any(when >= before for when in lost)


class Feasibility:
    """Computes, for any situations of one phase, which modes could run with unlimited resources.

    What these situations have in common is computed once. For each situation the modes that cannot run are
    removed, round by round. After the first round, each round checks only the modes that read data of modes
    removed in the previous round; the needs of all other modes are still met.
    """

    def __init__(self, spec: Spec, phase: str | None) -> None:
        self._whole, self._spec = spec, spec.in_phase(phase)
        self._homes = {name: hosts_when_all_is_up(spec, module) for name, module in spec.modules.items()}
        self._producers: dict[str, list[tuple[Module, Mode]]] = {variable: [] for variable in spec.variables}
        self._readers: dict[str, list[tuple[Module, Mode]]] = {variable: [] for variable in spec.variables}
        every = [(module, mode) for module in self._spec.modules.values() for mode in module.modes.values()]
        for module, mode in every:
            for variable in mode.gives:
                self._producers[variable].append((module, mode))
            for variable in {leaf.variable for _, leaf in mode.leaves()}:
                self._readers[variable].append((module, mode))
        self._intact = survivors(spec, Situation())
        intact = Feasible(self._spec, Situation(), self._intact, {}, self._producers)
        self._drivers: dict[str, list[str]] = {device: [] for device in spec.devices}
        for module in spec.modules.values():
            if module.device is not None:
                self._drivers[module.device].append(module.name)
        self._homeless = [m.name for m in spec.modules.values() if not self._hosts(m, intact.left)]
        self._never_met = [(module, mode) for module, mode in every if not intact.can_hold(mode.needs, 1)]

    def in_situation(self, now: Situation, left: Survivors | None = None) -> Feasible:
        """Compute what could run in a situation; its phase must be the phase of this object.

        left: the survivors of the situation, if they are already computed; None: compute them.
        """
        left = survivors(self._whole, now, self._intact) if left is None else left
        homeless = [m for m in self._suspects(now) if not self._hosts(m, left)]
        fallen = [(module, mode) for module in homeless for mode in module.modes.values()]
        found = Feasible(self._spec, now, left, {}, self._producers)
        checked, rounds = self._never_met, 0
        while fallen or not rounds:
            found.lost.update({(module.name, mode.name): rounds for module, mode in fallen})
            rounds += 1
            fallen = [
                (module, mode)
                for module, mode in [*checked, *self._reading(fallen)]
                if (module.name, mode.name) not in found.lost and not found.can_hold(mode.needs, rounds)
            ]
            checked = []
        return found

    def _hosts(self, module: Module, left: Survivors) -> tuple[str, ...]:
        return left.hosts_among(module, self._homes[module.name])

    def _suspects(self, now: Situation) -> Iterable[Module]:
        """Return the modules that may have no PE in a situation: all of them if a PE or a bus is down."""
        suspects = dict.fromkeys(self._homeless)
        for kind, _, name in (element.partition(":") for element in now.down):
            if kind == "device":
                suspects.update(dict.fromkeys(self._drivers.get(name, ())))
            elif kind == "module":
                suspects[name.partition("@")[0]] = None
            else:
                return self._spec.modules.values()
        return [self._spec.modules[name] for name in suspects if name in self._spec.modules]

    def _reading(self, fallen: list[tuple[Module, Mode]]) -> Iterator[tuple[Module, Mode]]:
        """Yield each mode that reads a variable which some mode in `fallen` gives."""
        for variable in {variable for _, mode in fallen for variable in mode.gives}:
            yield from self._readers[variable]


def feasible(spec: Spec, now: Situation, left: Survivors | None = None) -> Feasible:
    """Compute what could run in a situation with unlimited resources.

    left: the survivors of the situation, if they are already computed; None: compute them.
    """
    return Feasibility(spec, now.phase).in_situation(now, left)


def why_unwanted(now: Situation, function: Function) -> str | None:
    """Return the sentence that says why a function is not wanted in a situation; None: it is wanted."""
    if now.priority_of(function):
        return None
    if function.priority_in(now.phase):
        return "its priority was changed to 0"
    return f"it is not wanted in phase {now.phase}" if now.phase is not None else "its priority is 0"


def why_not(found: Feasible, function: Function, *, alone: bool | None = None) -> str:
    """Return the sentence that says why a function is not served.

    alone: whether the function could be served if no other function were wanted; None: not known.
    """
    unwanted = why_unwanted(found.now, function)
    if unwanted:
        return unwanted
    manager_bus = found.spec.manager.bus
    if manager_bus not in found.left.bus_mbit_per_s:
        return f"nothing can be commanded, because the manager's bus {manager_bus} is down"
    outputs = [found.spec.modules[name] for name in function.outputs]
    if not any(found.can_run(module) for module in outputs):
        return _every_branch(found, outputs)
    if alone is None:
        return "it could run, but resources, deadlines or placement rules leave no room for it beside what is served"
    if alone:
        return "it could run alone, but what is served outranks it and leaves no room"
    return "the PEs and buses that are up cannot fit it, even alone"


def _every_branch(found: Feasible, outputs: list[Module]) -> str:
    causes = [_cause(found, module, module.modes) for module in outputs]
    if len(outputs) > 1 and len(set(causes)) == 1:
        return f"each of {' and '.join(module.name for module in outputs)} {causes[0]}"
    return ", and ".join(f"{module.name} {cause}" for module, cause in zip(outputs, causes, strict=True))


def _cause(found: Feasible, module: Module, modes: Collection[str], branched: bool = False) -> str:
    """Say why a module can run in none of `modes`, as a verb phrase.

    branched: True if this phrase becomes one entry of a list of alternatives; if the phrase has alternatives itself,
        it then names only the first of them.
    """
    if module.name in found.left.failed_modules:
        return "has failed"
    if not found.left.hosts(module):
        return _homeless(found, module)
    first_lost = min(modes, key=lambda mode: found.lost[module.name, mode])
    leaf = _unmet(found, module.modes[first_lost].needs, before=found.lost[module.name, first_lost])
    givers: dict[str, list[str]] = {}
    for giver, mode in found.givers(leaf):
        givers.setdefault(giver.name, []).append(mode.name)
    if not leaf.is_open_in(found.now.phase):
        return f"reads {leaf.variable} only in phase {listed(sorted(leaf.only_in or ()), 'or')}"
    if not givers:
        return f"needs {_wanted(found, leaf)}, which no module gives"
    shown = list(givers)[: 1 if branched else _NAMED_ALTERNATIVES]
    branched = branched or len(givers) > 1
    causes = [f"{name}, which {_cause(found, found.spec.modules[name], givers[name], branched)}" for name in shown]
    more = [f"{len(givers) - len(shown)} more that cannot run either"] if len(givers) > len(shown) else []
    return f"needs {_wanted(found, leaf)} from {', or from '.join([*causes, *more])}"


def _unmet(found: Feasible, needs: Expression | None, before: int) -> Leaf:
    """Find the first leaf that keeps an expression from holding.

    A mode that was removed in a round before `before` supplies no leaf.
    """
    while not isinstance(needs, Leaf):
        inputs = needs.inputs if needs is not None else ()
        needs = next(one for one in inputs if not found.can_hold(one, before))
    return needs


def _wanted(found: Feasible, leaf: Leaf) -> str:
    versions = found.spec.variables[leaf.variable].versions
    if (leaf.best, leaf.worst) == (1, versions):
        return leaf.variable
    return f"{leaf.variable}@{leaf.worst}" if leaf.best == leaf.worst else f"{leaf.variable}@<={leaf.worst}"


def _homeless(found: Feasible, module: Module) -> str:
    """Say, as a verb phrase, why a module that has not failed has no PE on which it can run."""
    homes = hosts_when_all_is_up(found.spec, module)
    if not homes:
        return "may run on no PE of the spec, by its device, runs_on and requires"
    if module.device is not None:
        if f"device:{module.device}" in found.now.down:
            return f"needs device {module.device}, which is down"
        return f"needs device {module.device} on {homes[0]}, which {_pe_cause(found, homes[0])}"
    if any((module.name, pe) in found.left.failed_places for pe in homes):
        return f"cannot run anywhere: {', '.join(f'{pe} {_place_cause(found, module, pe)}' for pe in homes)}"
    if len(homes) == 1:
        return f"may run on {homes[0]} only, which {_pe_cause(found, homes[0])}"
    return f"may run only on PEs that are gone: {', '.join(f'{pe} {_pe_cause(found, pe)}' for pe in homes)}"


def _place_cause(found: Feasible, module: Module, pe: str) -> str:
    if (module.name, pe) in found.left.failed_places:
        return "cannot run it"
    return _pe_cause(found, pe)


def _pe_cause(found: Feasible, pe: str) -> str:
    if f"pe:{pe}" in found.now.down:
        return "is down"
    return f"has no route to the manager's bus {found.spec.manager.bus}"
