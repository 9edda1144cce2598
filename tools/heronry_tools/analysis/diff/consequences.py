"""The consequences of a spec in each phase: the functions served, their load, and their single points of failure.

A single point of failure of a function is one element without which the function is not served, although the healthy
system serves it. Only critical functions (classes A to D) that the phase wants are examined. A plan for the loss of
each element would take minutes, so most losses are decided without a plan:

1. A function that cannot be served even with unlimited resources (`feasible`) is lost in every plan.
2. For the other functions, a configuration from an earlier plan is reduced to what still works without the element. If
   the reduced configuration is legal and serves all these functions, none of them is lost: the best plan is at least as
   good. Modules without a purpose in the reduced configuration do no harm, since they could be stopped. Exception: rule
   3 applies if the loss may make room for a function that the healthy system has to leave out.
3. For each remaining element a plan is made. From then on rule 2 also uses its configuration as an earlier plan, even
   for the next phase and the next spec.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.gates import holds
from heronry_dg.losses import lost_elements, used_elements
from heronry_dg.model import Function, Spec
from heronry_dg.objective import CRITICAL_CLASSES, serving_modules
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, elements, survivors
from heronry_dg.verify import verify
from heronry_dg.why_not import feasible
from heronry_manager.planner.exact import plan


@dataclass(frozen=True, slots=True)
class PhaseConsequences:
    """The consequences of a spec in one phase, with nothing down.

    served: for each function the module that serves it, with its mode if the module has several; "not wanted" if the
        phase does not want the function; None if it is wanted and not served.
    hangs_on: the single points of failure of each critical function that is served.
    bus_bits_per_s: the load of each bus.
    cpu_millis: the load of all PEs, in thousandths of a core.
    running: the best configuration.
    """

    served: Mapping[str, str | None]  # by function
    hangs_on: Mapping[str, tuple[str, ...]]  # critical function that is served -> its single points of failure
    bus_bits_per_s: Mapping[str, int]
    cpu_millis: int
    running: Configuration


@dataclass(slots=True)
class Consequences:
    """Computes the functions served, the load and the single points of failure of one spec after another (`of`).

    Every planned configuration is kept in `known`. For a later loss, also in a later phase or spec, no plan is
    made if one of these configurations still serves all functions in question (rule 2 in the file's head).
    """

    known: list[Configuration] = field(default_factory=list)

    def of(self, spec: Spec) -> dict[str | None, PhaseConsequences]:
        """Return, for each phase of a spec, which functions are served, their single points of failure, and the loads.

        A spec without phases has one entry, under None.
        """
        return {phase: self._in_phase(spec, phase) for phase in spec.phases or (None,)}

    def _in_phase(self, spec: Spec, phase: str | None) -> PhaseConsequences:
        healthy = self._plan(spec, Situation(phase=phase))
        return PhaseConsequences(
            served=dict(_served(spec, healthy)),
            hangs_on=self._hangs_on(spec, healthy),
            bus_bits_per_s={name: bus.bits_per_s for name, bus in healthy.buses.items()},
            cpu_millis=healthy.objective.cpu_millis,
            running=healthy.configuration,
        )

    def _plan(self, spec: Spec, now: Situation) -> Plan:
        found = plan(spec, now)
        self.known.insert(0, found.configuration)
        return found

    def _hangs_on(self, spec: Spec, healthy: Plan) -> dict[str, tuple[str, ...]]:
        critical = [
            function for function in _critical(spec, healthy.now.phase) if healthy.functions[function.name].served
        ]
        costs: dict[str, list[str]] = {function.name: [] for function in critical}
        used = used_elements(spec, healthy.configuration)
        for element in elements(spec):
            now = Situation(frozenset({element}), phase=healthy.now.phase)
            if not used.isdisjoint(lost_elements(spec, now)):
                for name in self._lost(spec, now, critical):
                    costs[name].append(element)
        return {name: tuple(culprits) for name, culprits in costs.items()}

    def _lost(self, spec: Spec, now: Situation, critical: list[Function]) -> list[str]:
        """Name those of the critical functions that the best plan of a situation does not serve."""
        found = feasible(spec, now)
        can_run = [f for f in _critical(spec, now.phase) if any(found.can_run(spec.modules[one]) for one in f.outputs)]
        possible = [function for function in can_run if function in critical]
        settles = possible in (critical, can_run)
        if possible and not (settles and any(_serves_all(spec, now, known, possible) for known in self.known)):
            planned = self._plan(spec, now)
            possible = [function for function in possible if planned.functions[function.name].served]
        return [function.name for function in critical if function not in possible]


def _critical(spec: Spec, phase: str | None) -> Iterator[Function]:
    for function in spec.functions.values():
        if function.criticality_in(phase) in CRITICAL_CLASSES and function.priority_in(phase) > 0:
            yield function


def _served(spec: Spec, found: Plan) -> Iterator[tuple[str, str | None]]:
    for function, output in serving_modules(spec, found.configuration):
        if function.priority_in(found.now.phase) == 0:
            yield function.name, "not wanted"
        elif output is None:
            yield function.name, None
        else:
            mode = found.configuration.modules[output].mode
            yield function.name, output if len(spec.modules[output].modes) == 1 else f"{output} ({mode})"


def _serves_all(spec: Spec, now: Situation, known: Configuration, wanted: list[Function]) -> bool:
    """Tell whether the part of a known configuration that still works serves all wanted functions and is legal.

    This part counts as legal here even if some of its modules serve no function.
    """
    left = _remains(spec, now, known)
    if not all(any(output in left.modules for output in function.outputs) for function in wanted):
        return False
    return all(violation.rule == "5.idle" for violation in verify(spec, now, left))


def _remains(spec: Spec, now: Situation, known: Configuration) -> Configuration:
    """Return the part of the configuration `known` that still works in the situation `now`.

    A module is kept if its PE can still run it in its mode, and its gates hold with the wires that are kept. A
    wire is kept if its producer is kept.
    """
    left = survivors(spec, now)
    modules = {
        name: running
        for name, running in known.modules.items()
        if name in spec.modules
        and running.mode in spec.modules[name].modes
        and running.pe in left.hosts(spec.modules[name])
    }
    while True:
        rewired = {
            name: Running(running.pe, running.mode, dict(_live_wires(modules, running)))
            for name, running in modules.items()
        }
        kept = {
            name: running
            for name, running in rewired.items()
            if holds(spec.modules[name].modes[running.mode].needs, running.inputs)
        }
        if kept == modules:
            return Configuration(kept)
        modules = kept


def _live_wires(modules: Mapping[str, Running], running: Running) -> Iterator[tuple[str, Wire]]:
    return ((path, wire) for path, wire in running.inputs.items() if wire.producer in modules)
