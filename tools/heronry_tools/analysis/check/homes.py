"""The PEs on which a module may run and has room, with everything up and nothing else on the PE."""

from heronry_dg.model import Mode, Module, Spec
from heronry_dg.situation import hosts_when_all_is_up


def fits(spec: Spec, module: Module, mode: Mode, pe: str) -> bool:
    """Tell whether a PE could carry a mode of a module if nothing else ran there."""
    offers = spec.pes[pe]
    return mode.cpu_millis <= offers.cpu_millis and mode.ram <= offers.ram and module.flash <= offers.flash


def homes(spec: Spec, module: str) -> tuple[str, ...]:
    """PEs on which some mode of a module could run, in the spec's order."""
    named = spec.modules[module]
    allowed = hosts_when_all_is_up(spec, named)
    return tuple(pe for pe in allowed if any(fits(spec, named, mode, pe) for mode in named.modes.values()))
