"""The check of DG308 and DG309: PEs that no manager reaches, with everything up.

Such PEs form *islands*: PEs that reach one another, but not the manager's bus. An island of several PEs lacks a
gateway. A single PE is more often on the wrong bus, so the finding is about this PE.
"""

from collections.abc import Iterator

from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_tools.analysis.check import resource_rules as rules


def check_reach(subject: Subject, findings: Findings) -> None:
    """Add a finding for each island of PEs."""
    manager = subject.spec.manager.bus
    for pes, buses in _islands(subject.spec):
        named = listed(f"'{pe}'" for pe in pes)
        if len(pes) == 1:
            sentence = (
                f"no manager reaches pe {named}: from {listed(buses)} no gateway leads to the manager's bus {manager}"
            )
            hint = f"put {pes[0]} on {manager}, or one PE on both of its bus and {manager}"
            findings.add(rules.PE_UNREACHED, subject.place("pes", pes[0], "buses"), sentence, hint)
        else:
            sentence = f"no gateway leads from bus '{buses[0]}' to the manager's bus {manager}"
            sentence = f"{sentence}, so no manager reaches pes {named}"
            hint = f"put one PE on both buses: buses: [{manager}, {buses[0]}]"
            findings.add(rules.NO_GATEWAY, subject.place("buses", buses[0]), sentence, hint)


def _islands(spec: Spec) -> Iterator[tuple[list[str], list[str]]]:
    """Yield the PEs and the buses of each island, in the spec's order."""
    commanded = survivors(spec, Situation()).pe_cpu_millis
    left = [pe for pe in spec.pes.values() if pe.name not in commanded]
    while left:
        buses, pes = set(left[0].buses), [left[0]]
        while joined := [pe for pe in left if pe not in pes and buses & set(pe.buses)]:
            pes += joined
            buses.update(*(pe.buses for pe in joined))
        left = [pe for pe in left if pe not in pes]
        yield [name for name, pe in spec.pes.items() if pe in pes], [name for name in spec.buses if name in buses]
