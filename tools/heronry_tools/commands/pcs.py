"""`heronry pcs`: component graphs of polymorphic control, assessed, edited, cut, and rewired by scripts.

Exit codes: 0 what was requested holds, or was done; 1 it does not hold, or cannot be done; 2 the input cannot be used.
With --json, an operation that cannot be done gives `{"error": NAME}`; docs/polymorphic.md lists the names.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from heronry_manager.core.vocabulary import ReleaseTarget
from heronry_manager.shell.control_client import call
from heronry_pcs import operations, views
from heronry_pcs.assessment import Assessment, assess
from heronry_pcs.graph import Edge, Graph, PcsError
from heronry_pcs.graph_files import JSON_SUFFIX, document, to_json
from heronry_pcs.names import COMPONENT_HINT, EDGE_HINT, edge_of, is_component
from heronry_pcs.plan_graph import level_view
from heronry_pcs.plan_script import module_graph
from heronry_pcs.predicates import PREDICATES
from heronry_pcs.script_difference import difference
from heronry_pcs.views import view_graph
from heronry_tools.analysis.control.cut import least_cut
from heronry_tools.analysis.control.longest_cycle import longest_cycle
from heronry_tools.analysis.control.subject import Subject, graph_path, load_planned, load_subject, shipped_spec_of
from heronry_tools.analysis.control.trial import try_script
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import manager_socket, say_answer
from heronry_tools.console.plan_argument import read_text
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.console.whole_file import write_whole
from heronry_tools.reports.control import assessment_text, cut_text, errors_text, graph_text, trial_text
from heronry_tools.reports.render.components import component_picture
from heronry_tools.reports.render.svg import svg
from heronry_tools.runtime.live_script import fly
from heronry_wire.spelling import meant


def run_graph(arguments: argparse.Namespace) -> int:
    """Derive and write a graph; returns the exit code."""
    with Working(f"deriving the graph of {arguments.subject}"):
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
    try:
        with Working(f"assessing {arguments.subject}"):
            subject = _subject(arguments)
            required = _required(arguments, subject)
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


def _required(arguments: argparse.Namespace, subject: Subject) -> Sequence[str]:
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
    try:
        with Working(f"editing {arguments.subject}"):
            graph, view = _edited(_subject(arguments).graph, arguments)
            assessed = _assessed(graph, view)
    except PcsError as error:
        return _refused(error, arguments)
    if arguments.write is not None:
        _save(graph, arguments.write)
    result = {"graph": document(graph), "check": assessed.document}
    _say(arguments, result, graph_text(graph) + assessment_text(assessed, ()))
    return 0


def _edited(graph: Graph, arguments: argparse.Namespace) -> tuple[Graph, Sequence[str] | None]:
    """Return the graph after the operation that `arguments` name, and the view after it: the members in it, sorted.

    With --at, `contract` and `expand` change the view, and leave the graph as it is; every other operation works on the
    view as a graph of its own, and there is no view after it (None).
    """
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


def _edge(text: str) -> Edge:
    edge = edge_of(text)
    if edge is None:
        raise UserError(f"'{text}' is no edge; {EDGE_HINT}")
    return edge


def run_script(arguments: argparse.Namespace) -> int:
    """Write the script that leads from one graph or plan to another; returns the exit code."""
    try:
        with Working(f"comparing {arguments.old} with {arguments.new}"):
            old, new = (_compared(text, arguments.spec) for text in (arguments.old, arguments.new))
            text = difference(old, new)
    except PcsError as error:
        return _refused(error, arguments)
    _say(arguments, {"script": text}, text)
    return 0


def _compared(text: str, spec: str | None) -> Graph:
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

    with Working(f"trying {arguments.script}"):
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
    if arguments.plan is not None or arguments.write is not None:
        raise UserError("--live changes the running configuration: leave --plan and --write out")
    text = read_text(arguments.script)
    spec, path = load_spec(arguments.subject), manager_socket(arguments)
    with Working("waiting until the script runs"):
        answer = fly(path, text, spec)
    return say_answer(arguments, answer)


def run_release(arguments: argparse.Namespace) -> int:
    """End the script whose result the manager holds; returns 0, or 1 if the manager holds none."""
    return say_answer(arguments, call(manager_socket(arguments), ReleaseTarget()))


def run_cut(arguments: argparse.Namespace) -> int:
    """Divide a component graph into two sides between which the least data pass; returns the exit code."""
    try:
        with Working(f"cutting {arguments.subject}"):
            subject = _subject(arguments)
            cut = least_cut(subject.graph, subject.first_side())
    except PcsError as error:
        return _refused(error, arguments)
    _say(arguments, {"mbit_per_s": cut.mbit_per_s, "sides": cut.sides}, cut_text(cut.mbit_per_s, cut.sides))
    return 0


def _subject(arguments: argparse.Namespace) -> Subject:
    return _load(arguments.subject, getattr(arguments, "plan", None))


def _load(text: str, plan: str | None = None) -> Subject:
    return load_subject(text, plan)


def _assessed(graph: Graph, view: Sequence[str] | None, path: Sequence[str] | None = None) -> Assessment:
    return assess(graph, view, path, longest_cycle)


def _refused(error: PcsError, arguments: argparse.Namespace) -> int:
    """Print why something cannot be done.

    Returns 2 if the user typed a name that the graph does not have, and 1 for any other reason.
    """
    if arguments.json:
        print(json.dumps({"error": error.error}))
    else:
        print(f"heronry: {error}", file=sys.stderr)
    return 2 if error.is_unknown else 1


def _save(graph: Graph, file: Path) -> None:
    if not file.name.endswith(JSON_SUFFIX):
        raise UserError(f"{file}: the resulting graph is written as JSON; give a file name that ends in {JSON_SUFFIX}")
    write_whole(file, to_json(graph).encode())


def _say(arguments: argparse.Namespace, result: Any, text: str) -> None:
    sys.stdout.write(json.dumps(result, indent=1, ensure_ascii=False) + "\n" if arguments.json else text)
