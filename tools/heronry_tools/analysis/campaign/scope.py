"""What a campaign covers, from the command line: how many faults, of which kinds, in which phases."""

import argparse
import os
from typing import Final

from heronry_dg.model import Spec
from heronry_dg.situation import elements, situation
from heronry_manager.planner.sweep import Scope
from heronry_tools.console.errors import UserError
from heronry_tools.console.scope_arguments import KINDS

MOST_SETS: Final = 10_000_000  # a day or two of planning


def scope_of(spec: Spec, arguments: argparse.Namespace, *, places: bool = False) -> Scope:
    """Return the scope that the command line describes; raises UserError if the value of an option cannot be used.

    places: whether each place that the fault-free plan of a phase uses may fail, too. This has an effect only
        if modules are among the kinds of elements that may fail.
    """
    faults = spec.contingency.faults if arguments.faults is None else arguments.faults
    if faults < 0:
        raise UserError(f"--faults {faults}: write how many faults may be present at the same time, 0 or more")
    wanted = arguments.phase or phases_of(spec)
    phases = tuple(dict.fromkeys(situation(spec, phase=phase).phase for phase in wanted))
    kinds = kinds_of(arguments.kinds)
    named = tuple(one for one in elements(spec) if one.partition(":")[0] in kinds)
    return feasible(Scope(named, faults, phases, places=places and "module" in kinds))


def phases_of(spec: Spec) -> tuple[str | None, ...]:
    """Return the phases that are planned ahead: those that the spec's `contingency` names, by default all phases.

    (None,) for a spec without phases.
    """
    return spec.contingency.phases or tuple(spec.phases) or (None,)


def feasible(scope: Scope) -> Scope:
    """Return the scope unchanged; raises UserError if it has more than MOST_SETS sets."""
    sets = scope.set_count() * len(scope.phases)
    if sets > MOST_SETS:
        less = "fewer faults at once, fewer phases, or fewer --kinds of elements"
        raise UserError(f"there are {sets} sets of faults, and at most {MOST_SETS} are tried: choose {less}")
    return scope


def jobs_of(arguments: argparse.Namespace) -> int:
    """Return the number of processes that make plans; raises UserError if `--jobs` is less than 1."""
    jobs = cpus() if arguments.jobs is None else int(arguments.jobs)
    if jobs < 1:
        raise UserError(f"--jobs {jobs}: at least one process must plan")
    return jobs


def cpus() -> int:
    """Return the number of CPUs that this process may use."""
    return len(os.sched_getaffinity(0))


def kinds_of(text: str | None, also: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Read the kinds of elements that may fail, as in `pe,bus`; None means all. Raises UserError for any other kind.

    also: kinds that may be named, too, but are not among all.
    """
    if text is None:
        return KINDS
    named = tuple(kind.strip() for kind in text.split(","))
    for kind in named:
        if kind not in (*KINDS, *also):
            raise UserError(f"--kinds: '{kind}' is no kind of element; the kinds are {', '.join((*KINDS, *also))}")
    return named
