"""`heronry campaign`: plans for every set of faults, and reports which functions survive.

Exit codes: 0 done, and every requirement holds; 1 a requirement is broken; 2 the input cannot be used.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

from heronry_dg.model import Spec
from heronry_manager.contingency.file_format import read_contingencies
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.page import html_page
from heronry_tools.analysis.campaign.report import json_report, text_report
from heronry_tools.analysis.campaign.requirements import Requirement, offences, read_requirement
from heronry_tools.analysis.campaign.scope import feasible, jobs_of, scope_of
from heronry_tools.analysis.campaign.survey import survey
from heronry_tools.analysis.campaign.sweeping import sweep
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec

Examined = tuple[Scope, Mapping[tuple[Phase, FaultSet], Outcome]]


def run(arguments: argparse.Namespace) -> int:
    """Plan for every set of faults, and report; returns the exit code."""
    spec = load_spec(arguments.spec)
    required = [read_requirement(spec, text) for text in arguments.require]
    examined = _made_now if arguments.contingencies is None else _made_ahead
    scope, outcomes = examined(spec, arguments, required)
    surveys = survey(spec, scope, outcomes)
    assessed = [(one, offences(spec, one, outcomes)) for one in required]
    report = {"text": text_report, "json": json_report, "html": html_page}[arguments.format]
    sys.stdout.write(report(spec, scope, surveys, assessed))
    return 1 if any(broken for _, broken in assessed) else 0


def _made_now(spec: Spec, arguments: argparse.Namespace, required: Sequence[Requirement]) -> Examined:
    """Make the plans of the scope on the command line, of more faults where a requirement names more."""
    named = scope_of(spec, arguments)
    scope = feasible(replace(named, faults=max([named.faults, *(one.faults for one in required)])))
    for one in required:
        if one.phase is not None and one.phase not in scope.phases:
            raise UserError(f"--require '{one.text}': phase {one.phase} is not examined; add --phase {one.phase}")
    with crew(jobs_of(arguments), arguments.scheduler) as executor:
        return scope, sweep(spec, scope, executor).outcomes


def _made_ahead(spec: Spec, arguments: argparse.Namespace, required: Sequence[Requirement]) -> Examined:
    """Read the plans of a contingency file, and leave out its places."""
    file = arguments.contingencies
    for option in ("faults", "phase", "kinds", "scheduler"):
        if getattr(arguments, option) is not None:
            raise UserError(f"--{option}: with --contingencies the file says what is examined; leave --{option} out")
    made = read_contingencies(file, spec)
    scope = replace(made.scope, places=False)
    for one in required:
        if one.faults > scope.faults:
            raise UserError(f"--require '{one.text}': {file} has plans for up to {scope.faults} faults; make it anew")
        if one.phase is not None and one.phase not in scope.phases:
            raise UserError(f"--require '{one.text}': {file} has no plans for phase {one.phase}; make it anew")
    every = set(scope.fault_sets())
    outcomes = {
        (phase, down): Outcome(made.configuration(plan.number), plan.objective, plan.optimal)
        for phase, down, plan in made.entries()
        if down in every
    }
    return scope, outcomes
