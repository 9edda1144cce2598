"""`heronry render`: a spec's dependency graph as a picture, with the symbols that `_EPILOG` lists.

Exit codes: 0 it is drawn; 2 the input cannot be used.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_down
from heronry_tools.console.spec_argument import add_spec_argument, load_spec

if TYPE_CHECKING:
    from heronry_tools.reports.render.graph import Graph

_EPILOG = """\
Squares are modules with a cell for each mode, circles are variables with the number of their versions, triangles are
devices. Gates: k/n OR, XOR, AND, DEMUX. What cannot run is crossed out; what a plan runs and wires is bold.

examples:
  heronry render elevator_and_chute -o graph.svg
  heronry render big_blue --function parachute -o parachute.svg         what the parachute depends on
  heronry render big_blue --down pe:nav -o without_nav.svg              what cannot run without a processor
  heronry plan big_blue -o plan.json && heronry render big_blue --plan plan.json -o running.svg
  heronry render my.dg.yaml --format mermaid                            for Markdown on a forge
  heronry render my.dg.yaml --format dot | dot -Tpdf -o graph.pdf       for Graphviz
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry render`."""
    parser = subparsers.add_parser(
        "render",
        description="Draw the dependency graph of a spec: as SVG, or as text for Mermaid or Graphviz.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--function", metavar="NAME", help="draw only what may contribute to this function")
    parser.add_argument(
        "--plan",
        metavar="PLAN.json",
        help="mark what this plan runs and wires, and what is down in the plan's situation (- for stdin)",
    )
    add_down(parser)
    add_output(parser, forms={"svg": (".svg",), "mermaid": (".mmd", ".mermaid"), "dot": (".dot", ".gv")})
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draw the graph; returns the exit code."""
    from heronry_tools.reports.render.svg import svg  # noqa: PLC0415 - `--help` does not need it
    from heronry_tools.reports.render.text import dot, mermaid  # noqa: PLC0415

    sys.stdout.write({"svg": svg, "mermaid": mermaid, "dot": dot}[arguments.format](_graph(arguments)))
    return 0


def _graph(arguments: argparse.Namespace) -> "Graph":
    from heronry_dg.plan import read_plan  # noqa: PLC0415
    from heronry_dg.situation import situation  # noqa: PLC0415
    from heronry_tools.console.plan_argument import errors_name, read_text  # noqa: PLC0415
    from heronry_tools.reports.render.build import build  # noqa: PLC0415
    from heronry_tools.reports.render.marks import marks  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    with errors_name(arguments.plan):
        plan = read_plan(read_text(arguments.plan), spec) if arguments.plan else None
    now = plan.now if plan is not None and arguments.down is None else situation(spec, arguments.down or ())
    name = arguments.function
    if name is not None and name not in spec.functions:
        raise UserError(f"{spec.name} has no function '{name}'; it has {', '.join(spec.functions)}")
    marked = marks(spec, now, plan.configuration if plan is not None else None)
    return build(spec, marked, spec.functions[name] if name is not None else None)
