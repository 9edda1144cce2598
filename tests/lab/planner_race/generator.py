"""Generated aircraft: realistic specs of any size, drawn from a seed, and faults for them.

The same arguments give the same spec, byte for byte, on every machine. The loader checks it, like any other spec.
"""

import json
import random
from collections.abc import Mapping
from dataclasses import dataclass

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.situation import Situation
from heronry_manager.planner.exact import Planner
from lab.planner_race.aircraft import Aircraft

_EFFORT = 2.0  # for the plan without a fault, which need not be optimal


@dataclass(frozen=True, slots=True)
class FaultCase:
    """The elements that are down, the phase, and what ran before: a good plan of the phase without a fault."""

    now: Situation
    running: Placement


def generate(seed: int, modules: int, pes: int, work: float = 1.05) -> Spec:
    """Draw a spec.

    modules: 30 or more, at most about 200 (identifiers run out). pes: 6..34. work: the CPU of every module in its
    best mode, as a share of the CPU of all PEs; nothing else depends on it.
    """
    document = Aircraft(random.Random(f"{seed} {modules} {pes}"), modules, pes).document(work)
    return loads(json.dumps(document, indent=1), f"generated {modules} x {pes}, seed {seed}")


def fault_cases(spec: Spec, seed: int, count: int) -> list[FaultCase]:
    """Draw situations with one or two faults, in any phase; the manager's own bus stays up."""
    rng = random.Random(f"{seed} faults")
    phases: list[str | None] = [*spec.phases] or [None]
    planner = Planner(spec)
    plans = {phase: planner.plan(Situation(phase=phase), effort=_EFFORT) for phase in phases}
    before = {phase: placement(found.configuration) for phase, found in plans.items()}
    return [_fault_case(rng, spec, before) for _ in range(count)]


def _fault_case(rng: random.Random, spec: Spec, before: Mapping[str | None, Placement]) -> FaultCase:
    phase = rng.choice(list(before))
    down = frozenset(_fault(rng, spec) for _ in range(rng.choice((1, 2))))
    return FaultCase(Situation(down=down, phase=phase), before[phase])


def _fault(rng: random.Random, spec: Spec) -> str:
    kind = rng.choices(("pe", "device", "module", "bus"), (10, 5, 4, 1))[0]
    names = {
        "pe": list(spec.pes),
        "device": list(spec.devices),
        "module": list(spec.modules),
        "bus": [bus for bus in spec.buses if bus != spec.manager.bus],
    }
    return f"{kind}:{rng.choice(names[kind])}"
