"""What may stop without a manager: the modules that serve nothing critical (`without_manager: safe_mode`).

A function is critical here if it is of class A to D in some phase in which it is wanted: the phase cannot change while
no manager is there to change it, and what a later phase needs should not have to be found again. A module of a
configuration is *expendable* unless it is an output of a critical function, or something that is not expendable is
wired to it. So nothing that stays reads from what stops, and what stays is gated as it was.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import CRITICALITIES, Spec
from heronry_dg.traffic import best_rank

_NOT_CRITICAL = len(CRITICALITIES) - 1


def expendable(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """Return the modules of a legal configuration that serve nothing critical."""
    critical = [f for f in spec.functions.values() if best_rank(spec, f) < _NOT_CRITICAL]
    frontier = [output for function in critical for output in function.outputs if output in configuration.modules]
    kept: set[str] = set()
    while frontier:
        module = frontier.pop()
        if module not in kept:
            kept.add(module)
            frontier += [wire.producer for wire in configuration.modules[module].inputs.values()]
    return frozenset(configuration.modules.keys() - kept)
