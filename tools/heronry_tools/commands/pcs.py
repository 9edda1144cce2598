"""`heronry pcs`: component graphs of polymorphic control, assessed, edited, cut, and rewired by scripts.

Exit codes: 0 what was requested holds, or was done; 1 it does not hold, or cannot be done; 2 the input cannot be used.
With --json, an operation that cannot be done gives `{"error": NAME}`; docs/polymorphic.md lists the names.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_argument import add_manager_argument, manager_socket, say_answer
from heronry_tools.console.output import TEXT_OR_JSON, Forms, add_output
from heronry_wire.spelling import meant

if TYPE_CHECKING:
    from heronry_pcs.assessment import Assessment
    from heronry_pcs.graph import Edge, Graph, PcsError
    from heronry_tools.analysis.control.subject import Subject

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
    cut = _command(commands, "cut", "tell what two sides exchange at least", run_cut)
    _add_subject(cut)


def _command(
    commands: Any, name: str, does: str, run: Any, *, epilog: str | None = None, forms: Forms = TEXT_OR_JSON
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
    parser = _command(commands, "graph", does, run_graph, forms={**TEXT_OR_JSON, "svg": (".svg",)})
    _add_subject(parser)
    parser.add_argument(
        "--level",
        choices=("module", "pe", "side"),
        default="module",
        help="show each module, PE or side of the radio as one symbol (default: module)",
    )


def _add_check(commands: Any) -> None:
    parser = _command(commands, "check", "assess a component graph", run_check)
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
        run_edit,
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
    parser = _command(commands, "script", "write the script that leads from one graph, or plan, to another", run_script)
    parser.add_argument("old", metavar="OLD", help="the component graph, or the plan, before the script")
    parser.add_argument("new", metavar="NEW", help="the component graph, or the plan, after the script")
    parser.add_argument("--spec", metavar="SPEC", help="the spec of the plans OLD and NEW, if it is not a shipped spec")


def _add_apply(commands: Any) -> None:
    parser = _command(commands, "apply", "try a reconfiguration script on a graph, or on a plan", run_apply)
    parser.add_argument("script", metavar="SCRIPT", help="a *.pcs.script file (- for standard input)")
    _add_subject(parser)
    _add_write(parser)
    parser.add_argument("--live", action="store_true", help="let the running manager of this spec carry the script out")
    add_manager_argument(parser)


def _add_release(commands: Any) -> None:
    parser = _command(commands, "release", "end the script that the running manager holds", run_release)
    add_manager_argument(parser)


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!r} leaves a name empty: write names with commas between them, as A,B")
    return names


def run_graph(arguments: argparse.Namespace) -> int:
    """Derive and write a graph; returns the exit code."""
    from heronry_pcs.graph_files import document  # noqa: PLC0415 - slow to import
    from heronry_pcs.plan_graph import level_view  # noqa: PLC0415
    from heronry_pcs.views import view_graph  # noqa: PLC0415
    from heronry_tools.reports.control import graph_text  # noqa: PLC0415
    from heronry_tools.reports.render.components import component_picture  # noqa: PLC0415
    from heronry_tools.reports.render.svg import svg  # noqa: PLC0415

    subject = _subject(arguments)
    if subject.planned is None and arguments.level != "module":
        raise UserError(f"{arguments.subject} is a graph, without PEs: leave --level out, which is for specs")
    graph = subject.graph
    if arguments.level != "module":
        graph = view_graph(graph, level_view(graph, arguments.level))
    if arguments.format == "svg":
        sys.stdout.write(svg(component_picture(graph, subject.graph), "Component graph"))
    else:
        _say(arguments, document(graph), graph_text(graph))
    return 0


def run_check(arguments: argparse.Namespace) -> int:
    """Assess a graph; returns 0 if every requirement holds, and 1 if one does not."""
    from heronry_pcs.graph import PcsError  # noqa: PLC0415
    from heronry_tools.reports.control import assessment_text  # noqa: PLC0415

    subject = _subject(arguments)
    required = _required(arguments, subject)
    try:
        assessed = _assessed(subject.graph, arguments.at, arguments.path)
    except PcsError as error:
        return _refused(error, arguments)
    plants = subject.critical_plants()
    missing = [name for name in required if not assessed.holds(name, plants)]
    said = assessment_text(assessed, missing)
    if "on_path" in required and plants == frozenset():
        said += "no plant is of class A or B, so 'on_path' required nothing: name another predicate with --require\n"
    _say(arguments, assessed.document, said)
    return int(bool(missing))


def _required(arguments: argparse.Namespace, subject: "Subject") -> Sequence[str]:
    from heronry_pcs.predicates import PREDICATES  # noqa: PLC0415

    if arguments.require is None:
        return ("configuration",) if subject.planned is None else ("on_path",)
    known = (*PREDICATES, "cycle_bound", "control_path", "on_path")
    for name in arguments.require:
        if name not in known:
            remedy = meant(name, known, there_is="the predicates are")
            raise UserError(f"--require: there is no predicate '{name}'; {remedy}")
    if "control_path" in arguments.require and arguments.path is None:
        raise UserError("--require control_path needs --path with the members through which one loop must pass")
    required: list[str] = arguments.require
    return required


def run_edit(arguments: argparse.Namespace) -> int:
    """Apply the operation of the command line to a component graph, and report the new graph with its assessment.

    The graph is also written to a file if the command line names one. Returns the exit code.
    """
    from heronry_pcs.graph import PcsError  # noqa: PLC0415
    from heronry_pcs.graph_files import document  # noqa: PLC0415
    from heronry_tools.reports.control import assessment_text, graph_text  # noqa: PLC0415

    try:
        graph, view = _edited(_subject(arguments).graph, arguments)
        assessed = _assessed(graph, view)
    except PcsError as error:
        return _refused(error, arguments)
    if arguments.write is not None:
        _save(graph, arguments.write)
    result = {"graph": document(graph), "check": assessed.document}
    _say(arguments, result, graph_text(graph) + assessment_text(assessed, ()))
    return 0


def _edited(graph: "Graph", arguments: argparse.Namespace) -> "tuple[Graph, Sequence[str] | None]":
    """Give the graph after the operation that `arguments` name, and the view after it: the members in it, sorted.

    With --at, `contract` and `expand` change the view, and leave the graph as it is; every other operation works on the
    view as a graph of its own, and there is no view after it (None).
    """
    from heronry_pcs import operations, views  # noqa: PLC0415
    from heronry_pcs.names import COMPONENT_HINT, is_component  # noqa: PLC0415

    given: list[str] = arguments.arguments
    view = arguments.at if arguments.at is not None else list(graph.members)
    if arguments.at is not None and arguments.operation not in ("contract", "expand"):
        graph = views.view_graph(graph, view)
    match arguments.operation, given:
        case "cprune", []:
            return operations.cprune(graph), None
        case "removal", [_, *_]:
            return operations.removal(graph, [_edge(text) for text in given]), None
        case "addition", [edge]:
            return operations.addition(graph, _edge(edge)), None
        case "addEdge", [edge]:
            return operations.add_edge(graph, _edge(edge)), None
        case "combine", [file, *rest] if len(rest) <= 1:
            edge_between = _edge(rest[0]) if rest else None
            return operations.combine(graph, _load(file).graph, edge_between), None
        case "contract", [name]:
            if arguments.of is not None and not is_component(name):
                raise UserError(f"'{name}' cannot be the name of a component: {COMPONENT_HINT}")
            changed, left = views.contract(graph, view, name, arguments.of)
            return changed, sorted(left)
        case "expand", [name]:
            changed, left = views.expand(graph, view, name)
            return changed, sorted(left)
    raise UserError(f"{arguments.operation} takes other arguments; see heronry pcs edit --help")


def _edge(text: str) -> "Edge":
    from heronry_pcs.names import EDGE_HINT, edge_of  # noqa: PLC0415

    edge = edge_of(text)
    if edge is None:
        raise UserError(f"'{text}' is no edge; {EDGE_HINT}")
    return edge


def run_script(arguments: argparse.Namespace) -> int:
    """Write the script that leads from one graph or plan to another; returns the exit code."""
    from heronry_pcs.graph import PcsError  # noqa: PLC0415
    from heronry_pcs.script_difference import difference  # noqa: PLC0415

    old, new = (_compared(text, arguments.spec) for text in (arguments.old, arguments.new))
    try:
        text = difference(old, new)
    except PcsError as error:
        return _refused(error, arguments)
    _say(arguments, {"script": text}, text)
    return 0


def _compared(text: str, spec: str | None) -> "Graph":
    from heronry_pcs.plan_script import module_graph  # noqa: PLC0415
    from heronry_tools.analysis.control.subject import graph_path, load_planned, shipped_spec_of  # noqa: PLC0415
    from heronry_tools.console.plan_argument import read_text  # noqa: PLC0415
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415

    if graph_path(text) is not None:
        return _load(text).graph
    of_plan = load_spec(spec) if spec is not None else shipped_spec_of(read_text(text))
    if of_plan is None:
        raise UserError(
            f"{text} is no component graph, and no plan of a shipped spec; if it is a plan of another spec, name that "
            "spec with --spec SPEC"
        )
    planned = load_planned(of_plan, text)
    return module_graph(planned.spec, planned.configuration)


def run_apply(arguments: argparse.Namespace) -> int:
    """Try a script, or with --live give it to the manager.

    Returns 0 if the script has no error. With --live, returns 0 if the manager runs the result of the script, and keeps
    it until `heronry pcs release`. Returns 1 in any other case.
    """
    if arguments.live:
        return _fly(arguments)
    from heronry_pcs.graph_files import document  # noqa: PLC0415
    from heronry_tools.analysis.control.trial import try_script  # noqa: PLC0415
    from heronry_tools.console.plan_argument import read_text  # noqa: PLC0415
    from heronry_tools.reports.control import errors_text, graph_text, trial_text  # noqa: PLC0415

    trial = try_script(read_text(arguments.script), _subject(arguments))
    if arguments.write is not None and not trial.errors:
        _save(trial.after, arguments.write)
    result = {
        "statements": trial.statements,
        "errors": [
            {"line": one.line, "column": one.column, "code": one.code, "sentence": one.sentence} for one in trial.errors
        ],
        "before": document(trial.before),
        "after": document(trial.after),
        **({"violations": list(trial.violations)} if trial.violations is not None else {}),
    }
    said = errors_text(arguments.script, trial.errors, trial.statements) if trial.errors else graph_text(trial.after)
    _say(arguments, result, said + trial_text(trial.statements, len(trial.errors), trial.violations or ()))
    return int(bool(trial.errors))


def _fly(arguments: argparse.Namespace) -> int:
    """Give a script to the running manager, and wait for the outcome.

    The manager either runs the result of the script, and keeps it until `heronry pcs release`, or refuses the script.
    """
    from heronry_tools.console.plan_argument import read_text  # noqa: PLC0415
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.runtime.live_script import fly  # noqa: PLC0415

    if arguments.plan is not None or arguments.write is not None:
        raise UserError("--live changes the running configuration: leave --plan and --write out")
    text = read_text(arguments.script)
    spec, path = load_spec(arguments.subject), manager_socket(arguments)
    return say_answer(arguments, fly(path, text, spec))


def run_release(arguments: argparse.Namespace) -> int:
    """End the script whose result the manager holds; returns 0, or 1 if the manager holds none."""
    from heronry_manager.core.vocabulary import ReleaseTarget  # noqa: PLC0415 - keeps other commands quick
    from heronry_manager.shell.control_client import call  # noqa: PLC0415

    return say_answer(arguments, call(manager_socket(arguments), ReleaseTarget()))


def run_cut(arguments: argparse.Namespace) -> int:
    """Divide a component graph into two sides between which the least data pass; returns the exit code."""
    from heronry_pcs.graph import PcsError  # noqa: PLC0415
    from heronry_tools.analysis.control.cut import least_cut  # noqa: PLC0415
    from heronry_tools.reports.control import cut_text  # noqa: PLC0415

    subject = _subject(arguments)
    try:
        cut = least_cut(subject.graph, subject.first_side())
    except PcsError as error:
        return _refused(error, arguments)
    _say(arguments, {"mbit_per_s": cut.mbit_per_s, "sides": cut.sides}, cut_text(cut.mbit_per_s, cut.sides))
    return 0


def _subject(arguments: argparse.Namespace) -> "Subject":
    return _load(arguments.subject, getattr(arguments, "plan", None))


def _load(text: str, plan: str | None = None) -> "Subject":
    from heronry_tools.analysis.control.subject import load_subject  # noqa: PLC0415

    return load_subject(text, plan)


def _assessed(graph: "Graph", view: "Sequence[str] | None", path: "Sequence[str] | None" = None) -> "Assessment":
    from heronry_pcs.assessment import assess  # noqa: PLC0415
    from heronry_tools.analysis.control.longest_cycle import longest_cycle  # noqa: PLC0415

    return assess(graph, view, path, longest_cycle)


def _refused(error: "PcsError", arguments: argparse.Namespace) -> int:
    """Print why something cannot be done.

    Returns 2 if the user typed a name that the graph does not have, and 1 for any other reason.
    """
    if arguments.json:
        print(json.dumps({"error": error.error}))
    else:
        print(f"heronry: {error}", file=sys.stderr)
    return 2 if error.is_unknown else 1


def _save(graph: "Graph", file: Path) -> None:
    from heronry_pcs.graph_files import JSON_SUFFIX, to_json  # noqa: PLC0415
    from heronry_tools.console.whole_file import write_whole  # noqa: PLC0415

    if not file.name.endswith(JSON_SUFFIX):
        raise UserError(f"{file}: the resulting graph is written as JSON; give a file name that ends in {JSON_SUFFIX}")
    write_whole(file, to_json(graph).encode())


def _say(arguments: argparse.Namespace, result: Any, text: str) -> None:
    sys.stdout.write(json.dumps(result, indent=1, ensure_ascii=False) + "\n" if arguments.json else text)
