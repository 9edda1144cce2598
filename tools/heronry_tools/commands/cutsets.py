"""`heronry cutsets`: the smallest sets of faults after which a function cannot be served.

Exit codes: 0 done, whatever was found; 2 the input cannot be used.
"""

import argparse
import sys
from contextlib import nullcontext
from typing import Final

from heronry_dg.model import Spec
from heronry_dg.situation import elements, places, situation
from heronry_manager.planner.sweep import FaultSet, Scope
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.given_up import given_up
from heronry_tools.analysis.campaign.scope import feasible, jobs_of, kinds_of
from heronry_tools.analysis.campaign.sweeping import partial_of, sweep
from heronry_tools.analysis.reliability.cut_sets import CutSets, cut_sets, elements_searched, logic_of, sets_searched
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.report import Findings, json_report, text_report
from heronry_tools.analysis.reliability.resource_sets import Journal, most_useful_jobs
from heronry_tools.analysis.reliability.spec_hazards import mission_hours
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec, named_function

_EVERY_ORDER: Final = 1_000_000


def run(arguments: argparse.Namespace) -> int:
    """Find the cut sets of a function, and print them; returns the exit code."""
    spec = load_spec(arguments.spec)
    function = named_function(spec, arguments.function)
    hours = _mission(spec, arguments)
    scope, jobs = _scope(spec, arguments), jobs_of(arguments)
    logic = logic_of(spec, function.name, scope)
    cuts, left_out = None, None
    if not arguments.logical:
        cuts = _with_resources(spec, scope, logic, function.name, arguments)
        if arguments.given_up:
            left_out = _given_up(spec, scope, cuts, jobs)
    order = scope.faults if scope.faults < _EVERY_ORDER and arguments.by == "order" else None
    found = Findings(
        spec, function.name, scope, logic, cuts, left_out, hours, order, arguments.list, arguments.by == "likelihood"
    )
    sys.stdout.write((json_report if arguments.json else text_report)(found))
    return 0


def _mission(spec: Spec, arguments: argparse.Namespace) -> float:
    hours = mission_hours(spec) if arguments.mission is None else float(arguments.mission)
    if not 0.0 < hours < float("inf"):
        raise UserError(f"--mission {hours:g}: write the hours of the mission, a number above 0")
    if arguments.list < 0:
        raise UserError(f"--list {arguments.list}: write how many logical sets to list, 0 or more")
    return hours


def _scope(spec: Spec, arguments: argparse.Namespace) -> Scope:
    usual = _EVERY_ORDER if arguments.logical else spec.contingency.faults
    order = usual if arguments.order is None else arguments.order
    if order < 1:
        raise UserError(f"--order {order}: a set has at least one fault; write 1 or more")
    if arguments.logical and arguments.given_up:
        raise UserError("--logical plans nothing, and --given-up needs plans; leave one of them out")
    kinds = kinds_of(arguments.kinds, also=("place",))
    chosen = [one for one in elements(spec) if one.partition(":")[0] in kinds]
    if "place" in kinds:
        chosen += [place for module in spec.modules for place in places(spec, module)]
    scope = Scope(tuple(chosen), order, (situation(spec, phase=arguments.phase).phase,))
    return scope if arguments.logical else feasible(scope)


def _with_resources(
    spec: Spec, scope: Scope, logic: Reliability, function: str, arguments: argparse.Namespace
) -> CutSets:
    """Search resource-aware sets; with -o FILE, the journal FILE.partial keeps what is done."""
    number = sets_searched(logic, scope)
    about = ["cut sets", spec.digest, function, scope.phases[0], scope.faults, list(elements_searched(logic, scope))]
    file = arguments.report_file
    kept = nullcontext() if file is None else Journal(partial_of(file), about)
    jobs = min(jobs_of(arguments), most_useful_jobs(number))
    with kept as journal, crew(jobs) as executor, Progress() as progress:
        if journal is not None and journal.known:
            print(f"heronry: continuing {journal.file}, which has {journal.sets} fault sets", file=sys.stderr)
        progress.begin("fault sets", number)
        try:
            found = cut_sets(spec, function, scope, logic, executor=executor, journal=journal, advance=progress.step)
        except KeyboardInterrupt:
            if journal is not None:
                print(f"heronry: stopped; the same command continues from {journal.file}", file=sys.stderr)
            raise
        if journal is not None:
            journal.remove()
    return found


def _given_up(spec: Spec, scope: Scope, cuts: CutSets, jobs: int) -> list[FaultSet]:
    with crew(jobs) as executor:
        outcomes = sweep(spec, scope, executor).outcomes
    return given_up(spec.functions[cuts.function], cuts.resources, scope.phases[0], outcomes)
