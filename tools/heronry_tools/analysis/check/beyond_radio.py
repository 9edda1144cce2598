"""The check of DG406: modules of functions of class A or B that may run beyond a wireless bus.

A PE is *beyond* a wireless bus if its route to the manager's bus crosses such a bus. A module that may run only there,
for example the driver of a device there, is where it belongs, and gets no finding.
"""

from typing import Final

from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_tools.analysis.check import dependability_rules as rules

_CLASSES: Final = frozenset("AB")


def check_beyond_radio(subject: Subject, findings: Findings) -> None:
    """Add a finding for each module that a wanted function of class A or B uses, and that may run beyond a radio."""
    beyond = _beyond(subject.spec)
    if not beyond:
        return
    for name, function in _used(subject.spec).items():
        hosts = hosts_when_all_is_up(subject.spec, subject.spec.modules[name])
        far = [pe for pe in hosts if pe in beyond]
        near = [pe for pe in hosts if pe not in beyond]
        if far and near:
            where = listed(f"'{pe}'" for pe in far)
            sentence = f"module '{name}', which '{function}' uses, may run on pe {where}, beyond a wireless bus"
            hint = f"write runs_on: [{', '.join(near)}]"
            findings.add(rules.BEYOND_RADIO, subject.place("modules", name), sentence, hint)


def _beyond(spec: Spec) -> frozenset[str]:
    """Name the PEs whose route to the manager's bus crosses a wireless bus."""
    if spec.buses[spec.manager.bus].kind == "wireless":
        return frozenset()  # nothing is on a wire
    left = survivors(spec, Situation())
    doors = [name for name, pe in spec.pes.items() if spec.manager.bus in pe.buses]
    routes = {pe: left.route(doors[0], pe) or () for pe in left.pe_cpu_millis} if doors else {}
    return frozenset(pe for pe, route in routes.items() if any(spec.buses[bus].kind == "wireless" for bus in route))


def _used(spec: Spec) -> dict[str, str]:
    """Name each module whose data reach a wanted function of class A or B, with the first such function."""
    used: dict[str, str] = {}
    for function in spec.functions.values():
        at = tuple(spec.phases) or (None,)
        if not any(function.priority_in(p) and function.criticality_in(p) in _CLASSES for p in at):
            continue
        waiting = [name for name in function.outputs if name not in used]
        while waiting:
            module = waiting.pop()
            if module in used:
                continue
            used[module] = function.name
            for mode in spec.modules[module].modes.values():
                for _, leaf in mode.leaves():
                    givers = spec.producers(leaf.variable)
                    waiting += [giver.name for giver, giving in givers if leaf.accepts(giving.gives[leaf.variable])]
    return {name: used[name] for name in spec.modules if name in used}
