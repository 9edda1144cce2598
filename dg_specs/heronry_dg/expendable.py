"""Which modules stop while no manager is heard: those that serve nothing critical (`without_manager: safe_mode`).

A function is critical here if it has class A to D in any phase in which it is wanted. All phases count, and not only
the present one, so that the functions of a later phase already run when that phase begins.

A module of a configuration keeps running if it is an output of a critical function, or if a module that keeps running
reads its data. All other modules are *expendable*. So the modules that keep running read nothing from the modules that
stop, and their gates hold as before.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Spec
from heronry_dg.traffic import best_rank

_NOT_CRITICAL = len(CRITICALITIES) - 1


def expendable(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """Return the modules of a legal configuration that may stop while no manager is heard."""
    critical = [f for f in spec.functions.values() if best_rank(spec, f) < _NOT_CRITICAL]
    frontier = [output for function in critical for output in function.outputs if output in configuration.modules]
    kept: set[str] = set()
    while frontier:
        module = frontier.pop()
        if module not in kept:
            kept.add(module)
            frontier += [wire.producer for wire in configuration.modules[module].inputs.values()]
    return frozenset(configuration.modules.keys() - kept)
