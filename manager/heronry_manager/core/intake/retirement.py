"""What it means to retire an element: the elements that count as failed, and why it cannot be retired now.

A PE that is retired still works, and executes commands until it is switched off. So not the PE counts as failed, but
each place on it at which a module can run, and each module that can run nowhere else. The PE goes on to forward what
passes through it. What drives an exclusive output there breaks before the next one makes, as in every reconfiguration.

    PE                       its places, and the modules that only it can run
    device, module, place,   the element itself
    bus

A gateway is retired after the PEs that only it connects with the manager: when it is switched off, they are lost.
"""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors


def parts_of(spec: Spec, element: str) -> tuple[str, ...]:
    """Return the elements that count as failed while `element` is retired; for a PE on which nothing can run: none."""
    kind, _, name = element.partition(":")
    if kind != "pe":
        return (element,)
    hosts = {module.name: hosts_when_all_is_up(spec, module) for module in spec.modules.values()}
    return tuple(
        f"module:{module}" if len(found) == 1 else f"module:{module}@{name}"
        for module, found in hosts.items()
        if name in found
    )


def connected_by(spec: Spec, element: str) -> tuple[str, ...]:
    """Return the PEs that lose their route to the manager when `element` is switched off, in the spec's order."""
    before, after = (survivors(spec, Situation(down)).pe_cpu_millis for down in (frozenset(), frozenset((element,))))
    return tuple(pe for pe in spec.pes if pe in before and pe not in after and element != f"pe:{pe}")
