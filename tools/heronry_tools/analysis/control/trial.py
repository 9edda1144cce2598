"""Tries a reconfiguration script without an aircraft: on a component graph, or on a plan.

In a plan, the script moves and wires only modules; the components for devices and plants follow from the modules.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.verify import verify
from heronry_pcs.graph import Graph
from heronry_pcs.plan_graph import plan_graph
from heronry_pcs.plan_script import apply_to_plan
from heronry_pcs.script import interpret
from heronry_pcs.script_syntax import ScriptError
from heronry_tools.analysis.control.subject import Planned, Subject


@dataclass(frozen=True, slots=True)
class Trial:
    """The result of a script that was tried on a component graph or on a plan.

    statements: number of statements in the script.
    errors: errors of the script; if there are any, the graph after the script is the graph before it.
    before, after: the component graphs before and after the script.
    violations: for a plan: the reasons why the resulting configuration is not legal, empty if the script has
        errors; for a component graph: None.
    """

    statements: int
    errors: Sequence[ScriptError]
    before: Graph
    after: Graph
    violations: Sequence[str] | None = None


def try_script(text: str, subject: Subject) -> Trial:
    """Apply a script to the graph or the plan of a subject."""
    if subject.planned is not None:
        return _on_plan(text, subject.graph, subject.planned)
    outcome = interpret(text, subject.graph)
    return Trial(outcome.statements, outcome.errors, subject.graph, outcome.after)


def _on_plan(text: str, before: Graph, planned: Planned) -> Trial:
    outcome = apply_to_plan(text, planned.spec, planned.now, planned.configuration)
    if outcome.errors:
        return Trial(outcome.statements, outcome.errors, before, before, ())
    broken = [str(violation) for violation in verify(planned.spec, planned.now, outcome.configuration)]
    no_wires = [
        f"{start} -> {end} is no wire: it must lead from what a running module gives to an input of that variable, "
        "and to each input only once"
        for start, end in outcome.no_wires
    ]
    after = plan_graph(planned.spec, outcome.configuration)
    return Trial(outcome.statements, (), before, after, [*no_wires, *broken])
