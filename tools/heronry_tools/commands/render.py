"""`heronry render`: a spec's dependency graph as a picture, with the symbols that `_EPILOG` lists.

Exit codes: 0 it is drawn; 2 the input cannot be used.
"""

import argparse
import sys

from heronry_dg.plan import read_plan
from heronry_dg.situation import situation
from heronry_tools.console.errors import UserError
from heronry_tools.console.plan_argument import errors_name, read_text
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Graph
from heronry_tools.reports.render.marks import marks
from heronry_tools.reports.render.svg import svg
from heronry_tools.reports.render.text import dot, mermaid


def run(arguments: argparse.Namespace) -> int:
    """Draw the graph; returns the exit code."""
    with Working(f"drawing {arguments.spec}"):
        text = {"svg": svg, "mermaid": mermaid, "dot": dot}[arguments.format](_graph(arguments))
    sys.stdout.write(text)
    return 0


def _graph(arguments: argparse.Namespace) -> Graph:
    spec = load_spec(arguments.spec)
    with errors_name(arguments.plan):
        plan = read_plan(read_text(arguments.plan), spec) if arguments.plan else None
    now = plan.now if plan is not None and arguments.down is None else situation(spec, arguments.down or ())
    name = arguments.function
    if name is not None and name not in spec.functions:
        raise UserError(f"{spec.name} has no function '{name}'; it has {', '.join(spec.functions)}")
    marked = marks(spec, now, plan.configuration if plan is not None else None)
    return build(spec, marked, spec.functions[name] if name is not None else None)
