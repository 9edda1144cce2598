"""`heronry export` and `heronry import`: fault trees for other tools of reliability, and from them.

Exit codes: 0 done; 2 the input cannot be used.
"""

import argparse
import sys

from heronry_dg.situation import elements, situation
from heronry_tools.analysis.campaign.scope import kinds_of
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.reliability.open_psa.reading import read_tree
from heronry_tools.analysis.reliability.open_psa.spec_text import spec_text
from heronry_tools.analysis.reliability.open_psa.writing import fault_tree
from heronry_tools.analysis.reliability.spec_hazards import hazards, mission_hours
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec, named_function


def run_export(arguments: argparse.Namespace) -> int:
    """Write the fault tree of a function; returns the exit code."""
    spec = load_spec(arguments.spec)
    function = named_function(spec, arguments.function).name
    phase = situation(spec, phase=arguments.phase).phase
    hours = mission_hours(spec) if arguments.mission is None else float(arguments.mission)
    if not 0.0 < hours < float("inf"):
        raise UserError(f"--mission {hours:g}: write the hours of the mission, a number above 0")
    kinds = kinds_of(arguments.kinds)
    may_fail = [one for one in elements(spec) if one.partition(":")[0] in kinds]
    with Working(f"the fault tree of {function}"):
        found = failure(spec.in_phase(phase), function, may_fail)
        text = fault_tree(function, found.formula, found.root, hazards(spec).among(may_fail), hours)
    sys.stdout.write(text)
    return 0


def run_import(arguments: argparse.Namespace) -> int:
    """Print the spec of a fault tree; returns the exit code."""
    with Working(f"reading {arguments.file}"):
        tree = read_tree(arguments.file)
        text = spec_text(tree, arguments.file.stem)
    if tree.without:
        some = ", ".join(tree.without[:4]) + (" ..." if len(tree.without) > 4 else "")
        print(f"heronry: no rate and no probability is read of {len(tree.without)} events: {some}", file=sys.stderr)
    sys.stdout.write(text)
    return 0
