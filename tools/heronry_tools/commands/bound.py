"""`heronry bound`: how long a reconfiguration takes at most, for every class of faults, and the parts of that time.

Exit codes: 0 every class of faults has a bound; 1 some class has none; 2 the input cannot be used.
"""

import argparse
import json
import time
from collections.abc import Sequence
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.situation import Situation, situation
from heronry_manager.bounds.fault_cases import count_plans, fault_cases
from heronry_manager.bounds.reconfiguration_bound import Bound, Bounds, Case
from heronry_manager.planner.exact import plan
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec
from heronry_tools.console.text_tables import Bad, Cell, Table, print_tables


def run(arguments: argparse.Namespace) -> int:
    """Print the longest time of a reconfiguration after each fault; returns the exit code."""
    spec = load_spec(arguments.spec)
    phase = situation(spec, phase=arguments.phase).phase
    cases, measured_ns = _planned(spec, phase)
    decide_ns = measured_ns if arguments.decide is None else arguments.decide
    limits = Bounds(spec)
    bounds = [limits.bound(case, decide_ns) for case in cases]
    if arguments.json:
        print(json.dumps(_document(spec, phase, bounds, is_measured=arguments.decide is None), indent=2))
    else:
        _print(spec, phase, bounds, is_measured=arguments.decide is None)
    return 0 if all(bound.total_ns is not None or bound.is_hopeless for bound in bounds) else 1


def _planned(spec: Spec, phase: str | None) -> tuple[list[Case], int]:
    """Plan for every fault; returns the cases, and the longest planning time in ns.

    The time of the first plan does not count, since the first call of the planner is slower.
    """
    longest_ns = made = 0
    most = count_plans(spec)

    def timed(now: Situation, running: Placement | None) -> Configuration:
        nonlocal longest_ns, made
        begun_ns = time.perf_counter_ns()
        found = plan(spec, now, running).configuration
        if made:  # the first one warms up
            longest_ns = max(longest_ns, time.perf_counter_ns() - begun_ns)
        made += 1
        progress.step()
        return found

    with Progress() as progress:
        progress.begin("plans, at most", most)
        cases = list(fault_cases(spec, phase, timed))
    return cases, longest_ns


def _worst(bounds: Sequence[Bound]) -> list[Bound]:
    """Return the largest bound for each class of faults and each bus on which PEs report.

    Faults after which no reconfiguration follows (`is_hopeless`) are left out.
    """
    worst: dict[str, Bound] = {}
    for bound in (one for one in bounds if not one.is_hopeless):
        known = worst.get(_named(bound))
        if known is None or _badness(bound) > _badness(known):
            worst[_named(bound)] = bound
    return list(worst.values())


def _named(bound: Bound) -> str:
    fault = bound.case.fault.value
    return f"{fault}, {bound.heard_on}" if bound.heard_on else fault


def _badness(bound: Bound) -> int:
    return 1 << 63 if bound.total_ns is None else bound.total_ns


def _print(spec: Spec, phase: str | None, bounds: Sequence[Bound], *, is_measured: bool) -> None:
    named = f", phase {phase}" if phase is not None else ""
    measured = "'decide' is measured on this machine, and all other times are bounds"
    how = measured if is_measured else "'decide' is given"
    rows: list[Sequence[Cell]] = []
    for bound in _worst(bounds):
        total: Cell = Bad("no bound") if bound.total_ns is None else _ms(bound.total_ns)
        parts = (bound.detect_ns, bound.decide_ns, bound.distribute_ns, bound.activate_ns, bound.wait_ns)
        rows.append((_named(bound), total, *(_ms(part) for part in parts), _remark(bound)))
    columns = ("at worst, ms", "total", "detect", "decide", "distribute", "activate", "T_lease", "where")
    hopeless = [(bound.case.element, bound.note) for bound in bounds if bound.is_hopeless]
    tables = [Table(columns, rows)] + ([Table(("beyond help", ""), hopeless)] if hopeless else [])
    print_tables(f"{spec.name}{named}: {how}", tables)


def _remark(bound: Bound) -> str:
    steps = ", ".join(step.name for step in bound.steps)
    facts = [f"{bound.slice_frames} SLICE, {steps}" if steps else "", bound.note]
    return "; ".join([bound.case.element, *(fact for fact in facts if fact)])


def _ms(time_ns: int | None) -> str:
    return "-" if time_ns is None else f"{time_ns / 1_000_000:.1f}"


def _document(spec: Spec, phase: str | None, bounds: Sequence[Bound], *, is_measured: bool) -> dict[str, Any]:
    return {
        "spec": spec.digest,
        "phase": phase,
        "decide_is": "measured" if is_measured else "given",
        "classes": {_named(bound): _facts(bound) for bound in _worst(bounds)},
        "faults": [{"class": bound.case.fault.value, **_facts(bound)} for bound in bounds],
    }


def _facts(bound: Bound) -> dict[str, Any]:
    return {
        "element": bound.case.element,
        "total_ns": bound.total_ns,
        "detect_ns": bound.detect_ns,
        "decide_ns": bound.decide_ns,
        "distribute_ns": bound.distribute_ns,
        "activate_ns": bound.activate_ns,
        "lease_wait_ns": bound.wait_ns,
        "slice_frames": bound.slice_frames,
        "steps": [step.name for step in bound.steps],
        "note": bound.note,
    }
