"""The command line of `heronry render`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_down
from heronry_tools.console.spec_argument import add_spec_argument

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
