"""The command line of `heronry pcs`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.manager_argument import add_manager_argument
from heronry_tools.console.output import TEXT_OR_JSON, Forms, add_output

_EPILOG = """\
A FILE is *.pcs.yaml or *.pcs.json, or the name of a shipped graph: g_eav, g_max, g_star. A SPEC is a *.dg.yaml, or a
shipped spec: its graph is that of its best plan with everything up, or of --plan PLAN.json.

examples:
  heronry pcs check g_eav --at Kfms,Kc,Km,Kuav --require configuration,cycle_bound
  heronry pcs check big_blue                                  is every critical plant on a control path?
  heronry pcs graph elevator_and_chute --level pe             the graph of its best plan, one symbol for each PE
  heronry pcs graph g_star -o g_star.svg                      a picture; bold: loops through the physical world
  heronry pcs edit g_eav combine g_max --write both.pcs.json       two systems as one graph
  heronry pcs apply dg_specs/polymorphic/g_star.pcs.script both.pcs.json
  heronry pcs script both.pcs.json g_star                     the script that leads from one graph to the other
  heronry pcs apply moved.pcs.script big_blue --live          let the running manager carry a script out, and hold it
  heronry pcs release                                         ... until this command: then better plans are sought again
  heronry pcs cut g_star                                      the least bandwidth that the radio must carry
"""
_OPERATIONS = ("cprune", "removal", "addition", "addEdge", "combine", "contract", "expand")
_EDIT_EPILOG = """\
operations:
  cprune                   drop what has no neighbor
  removal S->T ..          remove edges, and prune
  addition S->T            add an edge between two members
  addEdge S->T             add an edge, and the leaf at its end
  combine FILE2 [S->T]     unite two graphs, joined by an edge
  contract K               in a view (--at), put K in the place of what is inside it; with --of, make K of these
  expand K                 in a view (--at), put what is inside K in its place
An edge has to be in quotes for a shell: 'A.a->B.b'. Without --at, the view is all members. With --at, the operations
above them work on the view as a graph of its own, for example without an edge between its members.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of `heronry pcs` and of its commands."""
    parser = subparsers.add_parser(
        "pcs", description="Assess, edit, cut and rewire component graphs of polymorphic control.", epilog=_EPILOG
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_graph(commands)
    _add_check(commands)
    _add_edit(commands)
    _add_script(commands)
    _add_apply(commands)
    _add_release(commands)
    cut = _command(commands, "cut", "tell what two sides exchange at least", "run_cut")
    _add_subject(cut)


def _command(
    commands: Any, name: str, does: str, run: str, *, epilog: str | None = None, forms: Forms = TEXT_OR_JSON
) -> argparse.ArgumentParser:
    description = f"{does[0].upper()}{does[1:]}."
    parser: argparse.ArgumentParser = commands.add_parser(name, help=does, description=description, epilog=epilog)
    add_output(parser, forms=forms)
    parser.set_defaults(run=run)
    return parser


def _add_subject(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("subject", metavar="FILE|SPEC", help="a component graph, or a spec")
    _add_plan(parser)


def _add_plan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--plan", metavar="PLAN.json", help="the plan of a spec (- for standard input; default: the best plan)"
    )


def _add_write(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--write", metavar="FILE", type=Path, help="write the resulting graph, as *.pcs.json")


def _add_view(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--at",
        metavar="K,..",
        type=_names,
        help="members (leaves or components) that together form the view of the graph (default: all members)",
    )


def _add_graph(commands: Any) -> None:
    does = "derive the component graph of a spec's plan, and print or draw it"
    parser = _command(commands, "graph", does, "run_graph", forms={**TEXT_OR_JSON, "svg": (".svg",)})
    _add_subject(parser)
    parser.add_argument(
        "--level",
        choices=("module", "pe", "side"),
        default="module",
        help="show each module, PE or side of the radio as one symbol (default: module)",
    )


def _add_check(commands: Any) -> None:
    parser = _command(commands, "check", "assess a component graph", "run_check")
    _add_subject(parser)
    _add_view(parser)
    parser.add_argument(
        "--require",
        metavar="P,..",
        type=_names,
        help=(
            "predicates that must be true for exit code 0 (default for a graph: 'configuration'; for a spec: 'on_path' "
            "for every plant of criticality A or B)"
        ),
    )
    parser.add_argument(
        "--path",
        metavar="K,..",
        type=_names,
        help="tell whether one loop passes through all of these members (leaves or components) of the graph",
    )


def _add_edit(commands: Any) -> None:
    parser = _command(
        commands,
        "edit",
        "apply an operation to a component graph",
        "run_edit",
        epilog=_EDIT_EPILOG,
    )
    parser.add_argument("subject", metavar="FILE", help="a component graph")
    parser.add_argument("operation", choices=_OPERATIONS, metavar="OPERATION", help=", ".join(_OPERATIONS))
    parser.add_argument(
        "arguments",
        nargs="*",
        metavar="ARGUMENT",
        help="edges, a file, or a member (a leaf or a component) of the graph, as the operation needs",
    )
    _add_view(parser)
    parser.add_argument(
        "--of", metavar="K,..", type=_names, help="for contract: the members that become the new component"
    )
    _add_write(parser)


def _add_script(commands: Any) -> None:
    parser = _command(
        commands, "script", "write the script that leads from one graph, or plan, to another", "run_script"
    )
    parser.add_argument("old", metavar="OLD", help="the component graph, or the plan, before the script")
    parser.add_argument("new", metavar="NEW", help="the component graph, or the plan, after the script")
    parser.add_argument("--spec", metavar="SPEC", help="the spec of the plans OLD and NEW, if it is not a shipped spec")


def _add_apply(commands: Any) -> None:
    parser = _command(commands, "apply", "try a reconfiguration script on a graph, or on a plan", "run_apply")
    parser.add_argument("script", metavar="SCRIPT", help="a *.pcs.script file (- for standard input)")
    _add_subject(parser)
    _add_write(parser)
    parser.add_argument("--live", action="store_true", help="let the running manager of this spec carry the script out")
    add_manager_argument(parser)


def _add_release(commands: Any) -> None:
    parser = _command(commands, "release", "end the script that the running manager holds", "run_release")
    add_manager_argument(parser)


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!r} leaves a name empty: write names with commas between them, as A,B")
    return names
