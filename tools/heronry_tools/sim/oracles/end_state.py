"""What must hold once no more faults are injected, compared with the true situation and the best plan for it.

- Every healthy PE has reported within the last three heartbeat periods of its slowest bus that it is ACTIVE, and all
  healthy PEs are in one epoch. A PE is healthy if it runs and can reach the manager's bus.
- In levels 1 to 3 (criticality, utility, inputs) the value of the configuration that was activated last is no less than
  that of the best plan. While the manager holds a script of the operator, this is required in level 1 only.
- The configuration that was activated last is legal in the true situation. For this rule a failed device or module
  counts as failed only after its failure was reported and acknowledged, or declared by the operator. If no PE is left,
  the rule does not apply, since no PE can run another configuration.
- The phase that the manager sends (CONTROL, HOLDS) is the true phase.
- In each class A to D, the sum of the priorities of the functions that are heard is no less than in the best plan.

The simulation evaluates these rules repeatedly until the aircraft has converged; the last result counts.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from heronry_dg.model import Spec
from heronry_dg.objective import CRITICAL_CLASSES, score
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, survivors
from heronry_dg.verify import verify
from heronry_tools.recording.commanded import Epoch
from heronry_tools.runtime.witness import PATIENCE_PERIODS, Witness
from heronry_tools.sim.oracles.epochs import LastState
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.planning import best_at_all
from heronry_wire.identifiers import state_id
from heronry_wire.state_frames import PeState

_PATIENCE_BEATS = 3
_NOTICED_WHEN_USED = ("device:", "module:")
_CLASSES = len(CRITICAL_CLASSES)
_VERIFIED_LEVELS = 6  # classes A to D, utility, inputs


@dataclass(frozen=True, slots=True)
class Seen:
    """What the oracles have observed so far: last states of the PEs, outputs, the epoch activated last, the phase."""

    last: dict[tuple[str, int], LastState]
    witness: Witness
    current: Epoch | None
    phase: str | None  # the phase that the active manager sent last
    held: set[str]  # elements whose failure was acknowledged or declared, and that were not cleared
    is_script_held: bool = False


def end_state(spec: Spec, truth: Situation, now_ns: int, seen: Seen) -> list[Violation]:
    """Return the requirements that are violated now; once the aircraft has converged there must be none."""
    stories = [
        *_unsettled(spec, truth, now_ns, seen.last),
        *_worse(spec, truth, seen.current, _CLASSES if seen.is_script_held else _VERIFIED_LEVELS),
        *_illegal(spec, truth, seen.current, seen.held),
        *(
            [("phase", f"the phase is {truth.phase}, but the manager sends {seen.phase}")]
            if seen.phase != truth.phase
            else ()
        ),
        *_unserved(spec, truth, now_ns, seen.witness),
    ]
    return [Violation(now_ns, rule, story) for rule, story in stories]


def unnoticed_ns(spec: Spec) -> int:
    """Return the longest time in ns for which a PE or a function can be silent before any node detects the silence."""
    beats_ns = max(bus.heartbeat_ns * (bus.misses + 1) for bus in spec.buses.values())
    outputs = (spec.modules[module] for function in spec.functions.values() for module in function.outputs)
    slowest_ns = max(10**12 // mode.rate_mhz for module in outputs for mode in module.modes.values())
    return beats_ns + (PATIENCE_PERIODS + 1) * slowest_ns


def _unsettled(
    spec: Spec, truth: Situation, now_ns: int, last: dict[tuple[str, int], LastState]
) -> Iterator[tuple[str, str]]:
    epochs = set()
    for pe in survivors(spec, truth).pe_cpu_millis:
        seen = last.get((spec.manager.bus, state_id(spec.pes[pe].node_id)))
        longest_ns = max(spec.buses[bus].heartbeat_ns for bus in spec.pes[pe].buses)
        if seen is None or now_ns - seen.t_ns > _PATIENCE_BEATS * longest_ns:
            yield "active", f"{pe} is healthy, but sends no state"
        elif seen.page.state is not PeState.ACTIVE:
            yield "active", f"{pe} is {seen.page.state.name} in epoch {seen.page.epoch}"
        else:
            epochs.add(seen.page.epoch)
    if len(epochs) > 1:
        yield "active", f"the healthy PEs are in epochs {sorted(epochs)}"


def _worse(spec: Spec, truth: Situation, current: Epoch | None, compared: int) -> Iterator[tuple[str, str]]:
    if current is None or current.configuration is None:
        return
    is_worth = score(spec, truth, current.configuration, None).key()[:compared]
    could_be = best_at_all(spec, truth).objective.key()[:compared]
    if is_worth < could_be:
        yield "optimal", f"epoch {current.number} has value {is_worth}, but the best plan has {could_be}"


def _illegal(spec: Spec, truth: Situation, current: Epoch | None, held: set[str]) -> Iterator[tuple[str, str]]:
    if current is None or current.configuration is None or not survivors(spec, truth).pe_cpu_millis:
        return
    known = {element for element in truth.down if element in held or not element.startswith(_NOTICED_WHEN_USED)}
    for broken in verify(spec, replace(truth, down=frozenset(known)), current.configuration):
        yield "legal", f"epoch {current.number}: {broken}"


def _unserved(spec: Spec, truth: Situation, now_ns: int, witness: Witness) -> Iterator[tuple[str, str]]:
    possible = best_at_all(spec, truth)
    for index, criticality in enumerate(CRITICAL_CLASSES):
        functions = [f for f in spec.functions.values() if f.criticality_in(truth.phase) == criticality]
        heard = [f.name for f in functions if witness.served(f.name, now_ns)]
        worth = sum(truth.priority_of(spec.functions[name]) for name in heard)
        if worth < possible.objective.critical[index]:
            silent = [name for name in _served(possible) if name not in heard and name in {f.name for f in functions}]
            yield "served", f"class {criticality}: no output heard of {', '.join(silent)}, which could be served"


def _served(plan: Plan) -> list[str]:
    return [name for name, report in plan.functions.items() if report.served]
