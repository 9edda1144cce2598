"""The changes whose reconfiguration gets a bound: every single fault of a spec, and the return of each PE.

Each fault is assumed to occur while the fault-free configuration runs. Each case is planned as the manager would plan
it: by the given planner, with as few changes to the running configuration as possible. A fault of a device or module
that the running plan does not use changes nothing, so no plan is made for it.
"""

from collections.abc import Callable, Iterator

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.situation import Situation, survivors
from heronry_manager.bounds.reconfiguration_bound import Case, FaultClass

Planner = Callable[[Situation, Placement | None], Configuration]


def fault_cases(spec: Spec, phase: str | None, plan: Planner) -> Iterator[Case]:
    """Yield a case for each single fault in a phase, and for the return of each PE.

    First come the faults that make PEs silent: of PEs, each followed by the return of the PE, then of buses. Then come
    the faults that a PE reports: of devices, then of modules. Elements of one kind come in spec order.

    plan: makes the configuration without faults, and the one after each fault or return.
    """
    healthy = Situation(phase=phase)
    runs = plan(healthy, None)
    silenced = list(_silenced(spec, phase))
    for fault, element, silent in silenced:
        now = Situation(frozenset({element}), {}, phase)
        after = plan(now, placement(runs))
        yield Case(fault, element, now, runs, after, silent=silent)
        if fault is FaultClass.PE_LOST:
            yield Case(FaultClass.PARTITION, element, now, runs, after, silent=silent)
            back = plan(healthy, placement(after))
            yield Case(FaultClass.PE_RETURNS, element, healthy, after, back, returns=silent)
    for fault, element in _reported(spec, runs):
        now = Situation(frozenset({element}), {}, phase)
        yield Case(fault, element, now, runs, plan(now, placement(runs)))


def count_plans(spec: Spec) -> int:
    """Return how many plans `fault_cases` requests for one phase that uses everything; one less for each gateway."""
    return 1 + 2 * len(spec.pes) + len(spec.buses) + len(spec.devices) + len(spec.modules)


def _silenced(spec: Spec, phase: str | None) -> Iterator[tuple[FaultClass, str, tuple[str, ...]]]:
    """Yield the faults that make PEs silent: class of the fault, element that fails, PEs that fall silent.

    The element is written `pe:NAME` or `bus:NAME`. A PE whose loss silences other PEs, too (a gateway), is
    yielded twice: as PE_LOST and as BUS_LOST. A bus is yielded even if no PE falls silent.
    """
    reached = survivors(spec, Situation(phase=phase)).pe_cpu_millis
    for kind, names in (("pe", spec.pes), ("bus", spec.buses)):
        for name in names:
            element = f"{kind}:{name}"
            left = survivors(spec, Situation(frozenset({element}), {}, phase)).pe_cpu_millis
            silent = tuple(pe for pe in reached if pe not in left)
            if kind == "pe" and silent:
                yield FaultClass.PE_LOST, element, silent
            if kind == "bus" or len(silent) > 1:
                yield FaultClass.BUS_LOST, element, silent


def _reported(spec: Spec, runs: Configuration) -> Iterator[tuple[FaultClass, str]]:
    used = {spec.modules[module].device for module in runs.modules}
    for device in spec.devices:
        if device in used:
            yield FaultClass.DEVICE_REPORTED, f"device:{device}"
    for module in spec.modules:
        if module in runs.modules:
            yield FaultClass.MODULE_REPORTED, f"module:{module}"
