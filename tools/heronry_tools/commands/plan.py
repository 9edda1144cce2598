"""`heronry plan` and `heronry verify`: find the best configuration in a situation; verify a given one.

Exit codes: 0 a plan was made, or a configuration is legal; 1 it is not legal; 2 the input cannot be used.
"""

import argparse
import json
import sys

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan, PlanError, read_configuration, read_running
from heronry_dg.situation import Situation
from heronry_dg.transition import Transition, transition
from heronry_dg.verify import verify
from heronry_dg.verify_transition import verify_transition
from heronry_manager.planner.greedy.planner import Greedy
from heronry_tools.console.errors import UserError
from heronry_tools.console.plan_argument import errors_name, evaluated_in, read_text, situation_of
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.reports.plan import print_plan
from heronry_wire.sansio import require


def run_plan(arguments: argparse.Namespace) -> int:
    """Make a plan, and print it as text or as JSON; returns the exit code."""
    with Working(f"planning {arguments.spec}"):
        spec = load_spec(arguments.spec)
        now = situation_of(spec, arguments)
        text = read_text(arguments.running) if arguments.running else None
        with errors_name(arguments.running):
            running = read_running(text, spec) if text is not None else None
        if arguments.planner == "greedy":
            found = _greedy(spec, now, running)
        else:
            found = _best(spec, now, running, arguments.effort)
        way = _way(spec, text, found, now) if text is not None else None
    if not arguments.json:
        print_plan(spec, found, arguments.planner, way)
    elif way is None:
        sys.stdout.write(found.to_json())
    else:
        document = {**found.document(), "transition": way.document()}
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    return 0


def _greedy(spec: Spec, now: Situation, running: Placement | None) -> Plan:
    return Greedy(spec).plan(now, running)


def _best(spec: Spec, now: Situation, running: Placement | None, effort: float | None) -> Plan:
    try:
        from heronry_manager.planner.exact import DEFAULT_EFFORT, plan  # noqa: PLC0415 - an extra; greedy needs none
        from heronry_manager.planner.explain import explained  # noqa: PLC0415 - as above
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] != "ortools":
            raise
        how = 'add it with: pip install "heronry[manager]", or use --planner greedy'
        raise UserError(f"the exact planner needs ortools, which is not installed; {how}") from error
    return explained(spec, plan(spec, now, running, effort=DEFAULT_EFFORT if effort is None else effort))


def _way(spec: Spec, text: str, found: Plan, now: Situation) -> Transition:
    """Return the transition from the running configuration to a plan; raises InvariantError if it is illegal."""
    before, after = _as_known(spec, text), found.configuration
    way = transition(spec, before, after, now)
    refusals = verify_transition(spec, before, after, now, way)
    require(not refusals, "the transition to this plan is not legal: {}", refusals)
    return way


def _as_known(spec: Spec, text: str) -> Configuration | Placement:
    """Read the running configuration from a plan; if the plan lacks wires, read only the modules' PEs and modes."""
    try:
        return read_configuration(text)
    except PlanError:
        return read_running(text, spec)


def run_verify(arguments: argparse.Namespace) -> int:
    """Verify a plan; returns 0 if the plan is legal, and 1 if it is not."""
    with Working(f"verifying {arguments.plan}"):
        spec = load_spec(arguments.spec)
        text = read_text(arguments.plan)
        with errors_name(arguments.plan):
            now, configuration = evaluated_in(spec, text, arguments), read_configuration(text)
        violations = verify(spec, now, configuration)
    if arguments.json:
        broken = [{"rule": one.rule, "where": one.where, "sentence": one.sentence} for one in violations]
        print(json.dumps({"legal": not violations, "violations": broken}, indent=2, ensure_ascii=False))
    else:
        print("\n".join(map(str, violations)) or "legal: no rule is broken")
    return 1 if violations else 0
