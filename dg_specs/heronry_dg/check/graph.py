"""DG23x and DG24x: parts of a spec that load, but have no effect or cannot have the effect that the author meant.

The check needs no solver, and considers all modes together. Every finding is certain. A part without a finding may
still be impossible for reasons of place and capacity; the checks with a solver find those reasons.

Consequences of a mistake are not reported. If no module gives an input, there is one finding at that input, and none
about the module that therefore never runs. Unused parts are reported only if all inputs can be wired. For example, if a
driver is missing, the input that nothing gives is reported, and not the device that has no driver.

How a rule is added: define the rule in rules/graph.py. Write a function `_thing(subject, findings)` in this file that
adds the findings of the rule, and call this function in `check`.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

from heronry_dg import yaml_source
from heronry_dg.check.actuators import check_actuators
from heronry_dg.check.hazards import check_hazards
from heronry_dg.check.plants import check_plants
from heronry_dg.check.silence import check_silence
from heronry_dg.check.subject import Subject
from heronry_dg.cycles import components, shortest_cycle
from heronry_dg.findings import Findings, listed
from heronry_dg.gates import And, Expression, Leaf, bounds
from heronry_dg.model import Function, Module, Spec, When
from heronry_dg.rules import graph as rules
from heronry_dg.rules.functions import UNUSED_RANGE
from heronry_wire.canaerospace import DataType, value_range

_Datum = tuple[str, int]  # variable, version
_Accepted = tuple[str, int, int]  # variable, best and worst version
D = TypeVar("D", _Datum, _Accepted)


def check(subject: Subject, findings: Findings) -> None:
    """Check a spec against every rule of this file, and add a finding for each mistake."""
    wiring = _Wiring(subject.spec)
    _inputs(subject, wiring, findings)
    _watched(subject, wiring, findings)
    _never_firing(subject, wiring, findings)
    _circles(subject, findings)
    _needs(subject, wiring, findings)
    _unused_variables(subject, findings)
    _unused_gates(subject, findings)
    _unused_devices(subject, findings)
    _unused_modules(subject, wiring, findings)
    _unfed_functions(subject, wiring, findings)
    _priority_ranges(subject, findings)
    check_actuators(subject, findings)
    check_hazards(subject, findings)
    check_plants(subject, findings)
    check_silence(subject, findings)


class _Wiring:
    """Tells which modules could give each variable, and which could read it, in any of their modes."""

    def __init__(self, spec: Spec) -> None:
        shared = spec.drivers_of_one_actuator().items()
        self.demux_of = {name: f"actuator {actuator}" for actuator, drivers in shared for name in drivers}
        self.demux_of |= {name: things[0] for name, things in spec.exclusive_things().items()}
        self.givers: dict[str, dict[int, list[str]]] = {}  # variable -> version -> modules
        self._reads: dict[str, list[_Accepted]] = {}
        self._gives: dict[str, list[_Datum]] = {}
        self._readers: dict[_Datum, list[str]] = defaultdict(list)
        self._groups: dict[_Accepted, frozenset[str]] = {}
        for module in spec.modules.values():
            modes = module.modes.values()
            self._gives[module.name] = list(dict.fromkeys(datum for mode in modes for datum in mode.gives.items()))
            self._reads[module.name] = list(dict.fromkeys(_accepted(leaf) for m in modes for _, leaf in m.leaves()))
            for variable, version in self._gives[module.name]:
                self.givers.setdefault(variable, {}).setdefault(version, []).append(module.name)
            for variable, best, worst in self._reads[module.name]:
                for version in range(best, worst + 1):
                    self._readers[variable, version].append(module.name)

    def is_given(self, leaf: Leaf) -> bool:
        """Tell whether some module gives a version that a leaf accepts."""
        return any(leaf.accepts(version) for version in self.givers.get(leaf.variable, {}))

    def groups(self, leaf: Leaf) -> frozenset[str]:
        """Return the names of the modules and DEMUXes that could be wired to a leaf.

        The name of a DEMUX stands for its branches, or for its ends, since only one of these modules runs at a time. So
        does the name of an actuator for its drivers, if there are several.
        """
        key = _accepted(leaf)
        if key not in self._groups:
            given = self.givers.get(leaf.variable, {}).items()
            names = (name for version, modules in given if leaf.accepts(version) for name in modules)
            self._groups[key] = frozenset(self.demux_of.get(name, name) for name in names)
        return self._groups[key]

    def upstream(self, modules: Iterable[str]) -> set[str]:
        """Return `modules`, and all modules from which these could get data, directly or through other modules."""
        return self._reached(modules, lambda name: self._reads[name], self._read_from)

    def downstream(self, modules: Iterable[str]) -> set[str]:
        """Return `modules`, and all modules that could get data from these, directly or through other modules."""
        return self._reached(modules, lambda name: self._gives[name], lambda datum: self._readers[datum])

    def _read_from(self, accepted: _Accepted) -> Iterable[str]:
        variable, best, worst = accepted
        for version, modules in self.givers.get(variable, {}).items():
            if best <= version <= worst:
                yield from modules

    def _reached(
        self, modules: Iterable[str], data: Callable[[str], Iterable[D]], beyond: Callable[[D], Iterable[str]]
    ) -> set[str]:
        found, seen = set(modules), set[D]()
        waiting = list(found)
        while waiting:
            for datum in data(waiting.pop()):
                if datum not in seen:
                    seen.add(datum)
                    new = set(beyond(datum)) - found
                    found |= new
                    waiting += new
        return found


def _accepted(leaf: Leaf) -> _Accepted:
    return leaf.variable, leaf.best, leaf.worst


def _inputs(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    """Find inputs that can never be wired."""
    for module in subject.spec.modules.values():
        for mode in module.modes.values():
            places = subject.leaf_places(module.name, mode.name)
            for place, (_, leaf) in zip(places, mode.leaves(), strict=True):
                if leaf.variable not in wiring.givers:
                    sentence = f"module '{module.name}' reads '{leaf.variable}', which no module gives"
                    hint = f"write gives: {{{leaf.variable}: 1}} in the module that should give it, or remove the input"
                    findings.add(rules.UNPRODUCED, place, sentence, hint)
                elif not wiring.is_given(leaf):
                    there = listed([f"{leaf.variable}@{version}" for version in sorted(wiring.givers[leaf.variable])])
                    sentence = f"module '{module.name}' reads {_accepted_text(leaf)}, which no module gives"
                    findings.add(rules.UNGIVEN_VERSION, place, sentence, f"modules give {there}")


def _accepted_text(leaf: Leaf) -> str:
    if leaf.best == leaf.worst:
        return f"'{leaf.variable}@{leaf.best}'"
    return f"'{leaf.variable}@<={leaf.worst}'"


def _watched(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    """Find phases whose rule never leads to them, because no module gives the variable of the rule."""
    for phase in subject.spec.phases.values():
        if phase.when is not None and phase.when.variable not in wiring.givers:
            sentence = f"phase '{phase.name}' watches '{phase.when.variable}', which no module gives"
            place = subject.place("phases", phase.name, "when", "variable")
            hint = f"watch another variable, or let a module give '{phase.when.variable}'"
            findings.add(rules.UNPRODUCED, place, sentence, hint)


def _never_firing(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    """Report each phase rule that can never fire although some module gives its variable."""
    for phase in subject.spec.phases.values():
        if phase.when is None or phase.when.variable not in wiring.givers:
            continue
        cause = _why_it_never_fires(subject.spec, wiring, phase.name, phase.when)
        if cause is not None:
            sentence, hint = cause
            place = subject.place("phases", phase.name, "when")
            findings.add(rules.NEVER_FIRES, place, f"the rule of phase '{phase.name}' never fires: {sentence}", hint)


def _priority_ranges(subject: Subject, findings: Findings) -> None:
    """Report each function that has a `priority_range`, and is wanted in no phase."""
    for function in subject.spec.functions.values():
        if function.priority_range is not None and not any(function.priority.values()):
            sentence = f"function '{function.name}' has a 'priority_range', and no phase wants the function"
            place = subject.place("functions", function.name, "priority_range")
            hint = (
                "a changed priority counts only where the spec's is above 0: raise it in a phase, or remove the range"
            )
            findings.add(UNUSED_RANGE, place, sentence, hint)


def _circles(subject: Subject, findings: Findings) -> None:
    """Report phases whose rules lead from one to the next in a circle, and all hold at one value of a variable.

    While the variable has that value, each of its messages would change the phase.
    """
    by_variable: dict[str, dict[str, When]] = {}
    for phase in subject.spec.phases.values():
        if phase.when is not None:
            by_variable.setdefault(phase.when.variable, {})[phase.name] = phase.when
    for variable, of_phase in by_variable.items():
        circle = _circle(of_phase)
        if circle:
            way = " -> ".join([*circle, circle[0]])
            findings.add(
                rules.CIRCLE,
                subject.place("phases", circle[0], "when"),
                f"the phase changes without end ({way}): "
                f"at one value of '{variable}', the rules of all these phases hold",
                f"choose thresholds so that no value of '{variable}' fulfils the rules of all these phases",
            )


def _circle(rules_of: Mapping[str, When]) -> list[str]:
    """Return the phases of a shortest circle, in order; the list is empty if there is no circle.

    The rule of each phase leads from the phase before it in the list to this phase, and the rule of the first phase
    leads from the last phase. All rules of the circle hold at one and the same value of the variable.

    rules_of: the rules that watch one variable, by the phase to which they lead.
    """
    thresholds = sorted({limit for when in rules_of.values() for limit in when.thresholds().values()})
    ends = [thresholds[0] - 1, thresholds[-1] + 1]
    for value in [*ends, *((low + high) / 2 for low, high in pairwise(thresholds))]:
        holding = {phase: when for phase, when in rules_of.items() if when.holds(value)}
        leads_on = {
            phase: [other for other, when in holding.items() if phase in when.origins and phase != other]
            for phase in holding
        }
        for component in components(leads_on):
            if len(component) > 1:
                return shortest_cycle(leads_on, component)
    return []


def _why_it_never_fires(spec: Spec, wiring: _Wiring, phase: str, rule: When) -> tuple[str, str] | None:
    origins = [origin for origin in rule.origins if origin != phase]
    if not origins:
        return "it leads here from no other phase", "write from: [...] with the phases in which it is to be checked"
    least, most = value_range(DataType[spec.variables[rule.variable].type])
    if not (rule.holds(least) or rule.holds(most)):
        return f"'{rule.variable}' is never beyond its threshold", f"'{rule.variable}' is {least:g} to {most:g}"
    givers = {name for names in wiring.givers[rule.variable].values() for name in names}
    wanted = (
        name
        for function in spec.functions.values()
        if any(function.priority_in(origin) for origin in origins)
        for name in function.outputs
    )
    if givers.isdisjoint(wiring.upstream(wanted)):
        where = f"in {listed(origins, 'or')} no module that gives '{rule.variable}' serves a wanted function"
        return where, "such modules do not run: let a function that is wanted there use the variable"
    return None


def _needs(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    """Find modes that can never run."""
    for module in subject.spec.modules.values():
        for mode in module.modes.values():
            if mode.needs is None or _Possible(module, wiring).holds(mode.needs):
                continue
            one_of_many = f"mode '{mode.name}' of module" if len(module.modes) > 1 else "module"
            sentence = f"{one_of_many} '{module.name}' can never run: its inputs are never all given at the same time"
            path = ("modules", module.name, "modes", mode.name, "needs")
            place = subject.place(
                *path if len(module.modes) > 1 or _has_modes(subject, module) else (*path[:2], "needs")
            )
            findings.add(
                rules.NEVER_HOLDS, place, sentence, "require fewer inputs, or let another module give some of them"
            )


def _has_modes(subject: Subject, module: Module) -> bool:
    node = subject.loaded.draft.modules[module.name].node
    return isinstance(node, yaml_source.Mapping) and "modes" in node.entries


@dataclass(frozen=True, slots=True)
class _Possible:
    """Tells whether the gates of a module can hold when as many other modules as possible run.

    The answer is no only if it is certain that a gate cannot hold.
    """

    module: Module
    wiring: _Wiring

    def holds(self, expression: Expression) -> bool:
        if isinstance(expression, Leaf):
            return self._sources(expression) != frozenset()
        if isinstance(expression, And):
            inputs = list(_flat(expression))
            return self._most(inputs) == len(inputs)
        fewest, _ = bounds(expression)
        return self._most(expression.inputs) >= fewest

    def _most(self, inputs: Sequence[Expression]) -> int:
        """Return an upper bound of the number of these inputs that hold at once.

        The bound takes into account that a module gives only one version of a variable at a time.
        """
        leaves: dict[str, list[frozenset[str] | None]] = defaultdict(list)
        most = 0
        for expression in inputs:
            if isinstance(expression, Leaf):
                leaves[expression.variable].append(self._sources(expression))
            else:
                most += self.holds(expression)
        for sources in leaves.values():
            unknown = sources.count(None)
            known = [found for found in sources if found]
            most += unknown + min(len(known), len(frozenset().union(*known)))
        return most

    def _sources(self, leaf: Leaf) -> frozenset[str] | None:
        """Return the names of the modules and DEMUXes that could be wired to a leaf while `module` runs.

        A DEMUX is named in place of its branches and ends, since only one of these modules runs at a time. If `module`
        itself is a branch or an end of a DEMUX, no other branch or end of that DEMUX runs. So the result names that
        DEMUX only if `module` itself gives what the leaf accepts.

        Returns None if no module gives what the leaf accepts.
        """
        if not self.wiring.is_given(leaf):
            return None
        groups, own = self.wiring.groups(leaf), self.wiring.demux_of.get(self.module.name)
        if own not in groups or any(
            leaf.accepts(mode.gives.get(leaf.variable, 0)) for mode in self.module.modes.values()
        ):
            return groups
        return groups - {own}  # other branches or ends of this module's DEMUX never run together with this module


def _flat(expression: Expression) -> Iterator[Expression]:
    """Yield the inputs of an AND; an AND among these inputs is replaced by its own inputs.

    An expression that is no AND is given unchanged.
    """
    if not isinstance(expression, And):
        yield expression
        return
    for child in expression.inputs:
        yield from _flat(child)


def _unused_variables(subject: Subject, findings: Findings) -> None:
    spec = subject.spec
    read = {
        leaf.variable for module in spec.modules.values() for mode in module.modes.values() for _, leaf in mode.leaves()
    }
    read |= {phase.when.variable for phase in spec.phases.values() if phase.when is not None}
    for name in spec.variables.keys() - read:
        sentence = f"variable '{name}' is read by no module and watched by no phase"
        findings.add(
            rules.UNUSED_VARIABLE,
            subject.place("variables", name),
            sentence,
            "remove the variable, or let a module read it",
        )


def _unused_gates(subject: Subject, findings: Findings) -> None:
    """Find named gates that no expression names; a DEMUX without readers is reported by the loader."""
    draft = subject.loaded.draft
    named: set[str] = set()
    for module in draft.modules.values():
        named |= set(yaml_source.texts(module.node))
    for entry in draft.shorthands.values():
        named |= set(yaml_source.texts(entry.node))
    for name in draft.shorthands.keys() - named:
        sentence = f"no expression names gate '{name}'"
        findings.add(
            rules.UNUSED_GATE,
            subject.place("gates", name),
            sentence,
            "remove the gate, or name it in `needs` of a mode",
        )


def _unused_devices(subject: Subject, findings: Findings) -> None:
    driven = {module.device for module in subject.spec.modules.values()}
    for name in subject.spec.devices.keys() - driven:
        sentence = f"device '{name}' is driven by no module"
        hint = f"remove it, or write device: {name} in the module that drives it"
        findings.add(rules.UNUSED_DEVICE, subject.place("devices", name), sentence, hint)


def _unused_modules(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    spec = subject.spec
    outputs = [name for function in spec.functions.values() if _is_ever_wanted(function) for name in function.outputs]
    for name in spec.modules.keys() - wiring.upstream(outputs):
        sentence = f"module '{name}' serves no function, so it never runs"
        hint = "make it the output of a function with a priority, let another module read what it gives, or remove it"
        findings.add(rules.UNUSED_MODULE, subject.place("modules", name), sentence, hint)


def _is_ever_wanted(function: Function) -> bool:
    return any(priority > 0 for priority in function.priority.values())


def _unfed_functions(subject: Subject, wiring: _Wiring, findings: Findings) -> None:
    devices = subject.spec.devices
    sensing = [
        module.name
        for module in subject.spec.modules.values()
        if module.device is not None and devices[module.device].kind == "sensor"
    ]
    fed = wiring.downstream(sensing)
    for function in subject.spec.functions.values():
        if fed.isdisjoint(function.outputs):
            sentence = f"function '{function.name}' is fed by no device: no sensor leads to '{function.output}'"
            hint = "write `device: SENSOR` in a module from which data reach the function"
            findings.add(rules.NO_SENSOR, subject.place("functions", function.name), sentence, hint)
