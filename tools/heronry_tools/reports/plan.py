"""A plan as text: functions, PEs, buses, and the transition from the running configuration to the plan.

The lines are suited to `grep`: each one shows a function, a module on a PE, or a bus.
"""

from collections.abc import Iterator, Sequence

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Survivors, survivors
from heronry_dg.transition import Transition
from heronry_tools.console.text_tables import Bad, Cell, Table, bar, print_tables
from heronry_wire.management import Step


def print_plan(spec: Spec, plan: Plan, planner: str, way: Transition | None = None) -> None:
    """Print a plan to standard output.

    planner: the name of the planner that has made the plan.
    way: the transition from the running configuration to the plan; None: no transition is printed.
    """
    tables = list(_tables(spec, plan))
    print_tables(_headline(spec, plan, planner), tables if way is None else [*tables, _way(way)])


def _headline(spec: Spec, plan: Plan, planner: str) -> str:
    phase = f", phase {plan.now.phase}" if plan.now.phase is not None else ""
    down = f", down: {', '.join(sorted(plan.now.down))}" if plan.now.down else ", nothing down"
    limits = "".join(f", {element} at {float(100 * share):g} %" for element, share in sorted(plan.now.limits.items()))
    proof = "the best there is" if plan.optimal else f"{planner} planner: legal, not proven to be the best"
    served = plan.objective
    classes = ", ".join(f"{name} {points}" for name, points in zip("ABCD", served.critical, strict=True))
    return (
        f"{spec.name}{phase}{down}{limits}\n"
        f"{proof}: critical {classes}; utility {served.utility}; inputs {served.inputs}; changes {served.changes}; "
        f"branches {served.branches}; {served.bus_bits_per_s} bit/s; CPU {served.cpu_millis / 1000:.3f}"
        f"{_proof(plan)}"
    )


def _proof(plan: Plan) -> str:
    """Write which levels of a plan are proven, and the bounds of the others.

    The text is empty if the plan is proven to be the best, or if none of its levels has a bound.
    """
    if plan.optimal or all(one.bound is None for one in plan.levels):
        return ""
    proven = ", ".join(one.level for one in plan.levels if one.proven)
    open_levels = ", ".join(f"{one.level} {one.value} (bound {one.bound})" for one in plan.levels if not one.proven)
    return f"\nproven: {proven or 'nothing'}; not proven: {open_levels}"


def _tables(spec: Spec, plan: Plan) -> Iterator[Table]:
    left = survivors(spec, plan.now)
    yield Table(("function", "class", "priority", "mode", "value", ""), list(_function_rows(spec, plan)))
    yield Table(("PE", "CPU", "RAM", "flash", "modules"), list(_pe_rows(spec, plan, left)))
    yield Table(("bus", "data, of the limit for data", "of the bit rate"), list(_bus_rows(plan, left)))


def _function_rows(spec: Spec, plan: Plan) -> Iterator[Sequence[Cell]]:
    for name, report in plan.functions.items():
        function = spec.functions[name]
        rank, priority = function.criticality_in(plan.now.phase), plan.now.priority_of(function)
        if report.served:
            output = next(module for module in function.outputs if module in plan.configuration.modules)
            yield name, rank, str(priority), report.mode or "", str(report.value), f"served by {output}"
        elif priority == 0:
            yield name, rank, "0", "-", "-", "not wanted"
        else:
            yield name, rank, str(priority), "-", "-", Bad(f"NOT SERVED: {report.why_not}")


def _pe_rows(spec: Spec, plan: Plan, left: Survivors) -> Iterator[Sequence[Cell]]:
    for name, used in plan.pes.items():
        pe = spec.pes[name]
        if name not in left.pe_cpu_millis:
            yield name, "-", "-", "-", Bad("is down" if f"pe:{name}" in plan.now.down else "cannot be reached")
            continue
        cpu = left.pe_cpu_millis[name]
        modules = [
            module if len(spec.modules[module].modes) == 1 else f"{module} ({running.mode})"
            for module, running in plan.configuration.modules.items()
            if running.pe == name
        ]
        yield (
            name,
            bar(used.cpu_millis, cpu, f"{used.cpu_millis / 1000:g}/{cpu / 1000:g}"),
            bar(used.ram, pe.ram, _bytes(used.ram, pe.ram)),
            _bytes(used.flash, pe.flash),
            modules[0] if modules else "",
        )
        for module in modules[1:]:
            yield "", "", "", "", module


def _bus_rows(plan: Plan, left: Survivors) -> Iterator[Sequence[Cell]]:
    for name, used in plan.buses.items():
        if name not in left.bus_mbit_per_s:
            yield name, Bad("is down"), "-"
            continue
        capacity = left.bus_mbit_per_s[name] // 1000
        share = bar(used.bits_per_s, capacity, f"{used.bits_per_s}/{capacity} bit/s")
        yield name, share, f"{used.load:.2%}"


def _way(way: Transition) -> Table:
    """Write the steps of a transition, one per line."""
    waited = [f"{pe} ({', '.join(why)})" for pe, why in way.wait_for.items()]
    why = {
        Step.BREAK: f"then wait for {'; '.join(waited)}",
        Step.GO: f"then wait T_lease, so that only one PE drives {', '.join(way.hold)}",
    }
    rows: list[Sequence[Cell]] = [(step.name, why.get(step, "")) for step in way.steps]
    return Table(("way there", f"interrupted: {', '.join(way.interrupted) or 'no function'}"), rows)


def _bytes(used: int, capacity: int) -> str:
    for unit, size in (("M", 1 << 20), ("K", 1 << 10)):
        if capacity >= size:
            return f"{used / size:.3g}/{capacity / size:.4g}{unit}"
    return f"{used}/{capacity}"
