"""The check of the rules DG4xx: functions that are lost with a single fault, and redundancy that is useless.

Lost functions, and plants that lose every control path, are found by planning for each single fault; useless redundancy
is found in the graph. A finding names the place in the spec where an engineer would remove the cause, or accept it:

    a lost function or plant    the element that fails
    a DEMUX                     its entry in `gates`
    a XOR or a voter            its first input
    a placement rule            the rule itself

If a spec has more sources than identifiers (DG505), nothing is planned, since the priorities of its frames are unknown.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from itertools import combinations
from typing import Final

from heronry_dg.check.subject import Subject
from heronry_dg.check.wire import lacks_identifiers
from heronry_dg.findings import Findings, Place, listed
from heronry_dg.model import Module, Spec
from heronry_dg.situation import Situation
from heronry_dg.why_not import Feasibility, why_not
from heronry_tools.analysis.check import dependability_rules as rules
from heronry_tools.analysis.check.beyond_radio import check_beyond_radio
from heronry_tools.analysis.check.homes import homes
from heronry_tools.analysis.check.lost_plants import lost_plants
from heronry_tools.analysis.check.redundancy import (
    INDEPENDENT_SOURCES,
    Alternatives,
    Dependence,
    independent,
    shared_pair,
)
from heronry_tools.analysis.check.single_faults import Loss, losses
from heronry_tools.analysis.check.wanted import Phase, in_phases
from heronry_tools.analysis.servable import Planning

_HIGH: Final = "AB"
_LOW: Final = "CD"
_SECTIONS: Final = {"pe": "pes", "device": "devices", "bus": "buses", "module": "modules"}
_LOST: Final = {  # (the element is a module, the functions are of class A or B) -> rule
    (False, True): rules.LOST_WITH_HARDWARE,
    (False, False): rules.LESSER_LOST_WITH_HARDWARE,
    (True, True): rules.LOST_WITH_MODULE,
    (True, False): rules.LESSER_LOST_WITH_MODULE,
}


def check(subject: Subject, findings: Findings) -> None:
    """Check a spec against every rule of dependability_rules.py, and add a finding for each mistake."""
    _placement_rules(subject, findings)
    _redundancy(subject, findings)
    check_beyond_radio(subject, findings)
    if not lacks_identifiers(subject.spec):
        _single_faults(subject, findings)


def _single_faults(subject: Subject, findings: Findings) -> None:
    planning = Planning(subject.spec)
    feasibility = cache(partial(Feasibility, subject.spec))  # by phase
    for loss in lost_plants(planning):
        _tell_plants(subject, findings, loss)
    for loss in losses(planning, subject.work):
        for high in (True, False):
            lost = _of_classes(subject.spec, loss.functions, _HIGH if high else _LOW)
            if lost:
                reason = _reason(subject.spec, feasibility, loss, next(iter(lost)))
                _tell_loss(subject, findings, loss, lost, reason, high=high)


def _tell_plants(subject: Subject, findings: Findings, loss: Loss) -> None:
    kind, _, name = loss.element.partition(":")
    plants = [
        f"'{plant}' ({subject.spec.plants[plant].criticality}{in_phases(subject.spec, at)})"
        for plant, at in loss.functions.items()
    ]
    sentence = f"the loss of {kind} '{name}' alone takes {listed(plants)} off every control path"
    hint = "heronry pcs check shows the loops of a plan"
    findings.add(rules.PLANT_LOST, subject.place(_SECTIONS[kind], name), sentence, hint)


def _of_classes(spec: Spec, functions: Mapping[str, tuple[Phase, ...]], classes: str) -> dict[str, str]:
    """Choose the functions that have one of these classes in a phase in which they are lost.

    functions: for each function, the phases in which it is lost.
    Returns for each chosen function a text with its name, its classes and the phases; the most critical function first.
    """
    words: dict[str, list[str]] = {}
    for level in classes:
        for name, at in functions.items():
            there = [phase for phase in at if spec.functions[name].criticality_in(phase) == level]
            if there:
                words.setdefault(name, []).append(f"{level}{in_phases(spec, there)}")
    return {name: f"'{name}' ({'; '.join(each)})" for name, each in words.items()}


def _reason(spec: Spec, feasibility: Callable[[Phase], Feasibility], loss: Loss, function: str) -> str:
    """Say why a function is lost with an element, in the first phase in which it is."""
    phase = loss.functions[function][0]
    left = feasibility(phase).in_situation(Situation(frozenset({loss.element}), phase=phase))
    return f"'{function}': {why_not(left, spec.functions[function])}"


def _tell_loss(
    subject: Subject, findings: Findings, loss: Loss, lost: Mapping[str, str], reason: str, *, high: bool
) -> None:
    kind, _, name = loss.element.partition(":")
    sentence = f"the loss of {kind} '{name}' alone costs {listed(lost.values())}"
    findings.add(_LOST[kind == "module", high], subject.place(_SECTIONS[kind], name), sentence, reason)


def _redundancy(subject: Subject, findings: Findings) -> None:
    """Find gates with useless redundancy.

    DEMUX, XOR   all alternatives are lost with one element
    voter        it has fewer than three independent inputs; inputs are independent if no two of them depend on the same
                 element
    """
    dependence = Dependence(subject.spec)
    for demux in subject.spec.demuxes.values():
        shared = dependence.of_ends(demux)
        if shared:
            what = "ends" if demux.to else "branches"
            sentence = f"all {what} of DEMUX '{demux.name}' are lost with {dependence.shown(shared)}"
            hint = f"its {what} are {listed(demux.ends)}"
            findings.add(rules.DEMUX_SHARES, subject.place("gates", demux.name), sentence, hint)
    for module in subject.spec.modules.values():
        for mode in module.modes.values():
            for gate in dependence.alternatives(module, mode):
                place = _gate_place(subject, module, mode.name, gate.path)
                if gate.is_choice:
                    _xor(dependence, findings, place, module, gate)
                else:
                    _voter(dependence, findings, place, module, gate)


def _xor(dependence: Dependence, findings: Findings, place: Place, module: Module, gate: Alternatives) -> None:
    shared = frozenset.intersection(*gate.inputs)
    if shared:
        sentence = f"all inputs of a XOR of '{module.name}' are lost with {dependence.shown(shared)}"
        hint = "feed one input from a PE, a sensor and a module that the others do not use"
        findings.add(rules.XOR_SHARES, place, sentence, hint)


def _voter(dependence: Dependence, findings: Findings, place: Place, module: Module, gate: Alternatives) -> None:
    there_are = independent(gate.inputs)
    if there_are < INDEPENDENT_SOURCES:
        first, second = shared_pair(gate.inputs)
        shared = dependence.shown(gate.inputs[first] & gate.inputs[second])
        sources = "1 independent source" if there_are == 1 else f"{there_are} independent sources"
        sentence = (
            f"the vote of {len(gate.inputs)} in '{module.name}' has {sources}: "
            f"inputs {first + 1} and {second + 1} are lost with {shared}"
        )
        hint = "feed each input from a PE and a sensor that no other input uses"
        findings.add(rules.VOTER_SHARES, place, sentence, hint)


def _gate_place(subject: Subject, module: Module, mode: str, path: str) -> Place:
    """Return the place in the file of the first input of a gate."""
    below = [at == path or at.startswith(f"{path}." if path else "") for at, _ in module.modes[mode].leaves()]
    return subject.leaf_places(module.name, mode)[below.index(True)]


def _placement_rules(subject: Subject, findings: Findings) -> None:
    """Find placement rules because of which some modules can never run at the same time."""
    spec = subject.spec
    bound = _bound_together(spec)
    for index, group in enumerate(spec.separate):
        place = subject.place("separate", index)
        for one, other in combinations(group, 2):
            if bound[one] == bound[other]:
                sentence = f"'{one}' and '{other}' are to be separate here, and together by other rules"
                findings.add(
                    rules.SEPARATE_AND_TOGETHER,
                    place,
                    sentence,
                    f"remove this rule, or a rule that keeps the two together: under both, '{one}' and '{other}' never "
                    "run at the same time",
                )
        _room_to_separate(spec, findings, place, group)
    for index, group in enumerate(spec.together):
        at_home = {name: set(homes(spec, name)) for name in group}
        for one, other in combinations([name for name in group if at_home[name]], 2):
            if not at_home[one] & at_home[other]:
                sentence = f"'{one}' and '{other}' are to be together, and no PE fits both"
                hint = f"{_where(spec, one)}, {_where(spec, other)}"
                findings.add(rules.TOGETHER_NOWHERE, subject.place("together", index), sentence, hint)


def _bound_together(spec: Spec) -> dict[str, str]:
    """Return a group for each module: modules that `together` binds, directly or through others, share one."""
    bound = {name: name for name in spec.modules}
    for group in spec.together:
        joined = {bound[name] for name in group}
        bound.update({name: bound[group[0]] for name, leader in bound.items() if leader in joined})
    return bound


def _room_to_separate(spec: Spec, findings: Findings, place: Place, group: Sequence[str]) -> None:
    placed: dict[str, str] = {}  # PE -> module
    homed = [name for name in group if homes(spec, name)]
    immediate = sum(_placed(spec, name, placed, set()) for name in homed)
    if immediate < len(homed):
        named = listed(f"'{name}'" for name in homed)
        sentence = f"of {named} at most {immediate} can run together on PEs of their own"
        findings.add(rules.SEPARATE_WITHOUT_ROOM, place, sentence, ", ".join(_where(spec, name) for name in homed))


def _placed(spec: Spec, module: str, placed: dict[str, str], tried: set[str]) -> bool:
    """Give the module a PE of its own in `placed`; tells whether that is possible.

    To make it possible, modules that already have a PE may be moved to another one (augmenting paths).
    placed: for each PE that is taken, its module. tried: the PEs that the search has already considered.
    """
    for pe in homes(spec, module):
        if pe not in tried:
            tried.add(pe)
            if pe not in placed or _placed(spec, placed[pe], placed, tried):
                placed[pe] = module
                return True
    return False


def _where(spec: Spec, module: str) -> str:
    return f"{module} fits on {listed(homes(spec, module), last='or')}"
