"""Component graphs, their assessment, cuts and scripts in words, for a terminal."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from heronry_pcs.assessment import NOT_SUFFICIENT, Assessment
from heronry_pcs.graph import Graph
from heronry_pcs.predicates import PREDICATES
from heronry_pcs.script_syntax import ScriptError
from heronry_wire.errors import on_one_line

_MOST_LISTED = 6
_MOST_OF_NO_SCRIPT = 3


def graph_text(graph: Graph) -> str:
    """Write a component graph: each of its components, and each of its edges.

    For a leaf, the text also says its image, and whether it is a plant or pinned to a side. For any other
    component, the text names the components in it.
    """
    vertices = "1 vertex" if len(graph.vertices) == 1 else f"{len(graph.vertices)} vertices"
    lines = [f"{graph.name}: {_count(graph.members, 'member')}, {vertices}, {_count(graph.edges, 'edge')}"]
    for name, member in graph.members.items():
        if name in graph.leaves:
            leaf = graph.leaves[name]
            facts = [f"image {leaf.image}"] if leaf.image != name else []
            facts += ["plant"] if leaf.plant else [f"pinned to {leaf.side}"] if leaf.side is not None else []
            lines.append(f"  {name}" + (f" ({', '.join(facts)})" if facts else ""))
        else:
            lines.append(f"  {name}: {_listed(sorted(member.components)) or 'closed'}")
    lines += [f"  {start} -> {end}" for start, end in sorted(graph.edges)]
    return "".join(f"{line}\n" for line in lines)


def assessment_text(assessed: Assessment, missing: Sequence[str]) -> str:
    """Write an assessment in words; `missing` names the requirements that do not hold."""
    document = assessed.document
    lines = [f"{name.replace('_', ' ')}: {_truth(document[name])}" for name in PREDICATES]
    lines += [f"  {name} is no component: {', '.join(broken)}" for name, broken in document["broken"].items()]
    lines += [f"cycle bound: {_truth(document['cycle_bound'])}", f"longest cycle: {_cycle(*document['longest_cycle'])}"]
    if "control_path" in document:
        lines.append(f"control path: {_truth(document['control_path'])}")
    lines += _paths(document["components"])
    lines += [f"required, but does not hold: {name}" for name in missing]
    return "".join(f"{line}\n" for line in lines)


def _paths(components: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, facts in components.items():
        if "on_path" in facts:
            yield f"plant {name}: {'on a control path' if facts['on_path'] else 'open, on no control path'}"
    if not any("on_path" in facts for facts in components.values()):
        yield "no member is a plant, so no control path is checked ('plants' of a spec, 'plant: true' in a graph)"
    looped = [name for name, facts in components.items() if facts["on_loop"]]
    yield f"on a loop: {_listed(looped) or 'none'}"
    for condition in ("controllable", "observable"):
        excluded = [name for name, facts in components.items() if facts[condition] == "excluded"]
        yield f"not {condition}: {_listed(excluded) or 'none excluded'} ({NOT_SUFFICIENT})"


def _truth(value: bool | None) -> str:
    return "open" if value is None else "yes" if value else "no"


def _cycle(least: int, most: int) -> str:
    if most == 0:
        return "none"
    return f"{least} members" if least == most else f"{least} to {most} members"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_LISTED
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:_MOST_LISTED])} and {more} more"


def cut_text(mbit_per_s: int, sides: Mapping[str, Sequence[str]]) -> str:
    """Write a cut in words: the bandwidth that crosses it (given in thousandths of a bit/s), and each side's leaves."""
    whole, thousandths = divmod(mbit_per_s, 1000)
    lines = [f"at least {f'{whole}.{thousandths:03}'.rstrip('0').rstrip('.')} bit/s cross"]
    lines += [f"  {side}: {', '.join(leaves)}" for side, leaves in sides.items()]
    return "".join(f"{line}\n" for line in lines)


def errors_text(file: str, errors: Sequence[ScriptError], statements: int) -> str:
    """Write the errors of a script in the form of 'heronry check': FILE:LINE:COLUMN: CODE error: SENTENCE.

    If a file has no statement, it is probably no script: only its first errors are written.
    """
    most = len(errors) if statements else _MOST_OF_NO_SCRIPT
    lines = [f"{file}:{_place(error)}: {error.code} error: {on_one_line(error.sentence)}\n" for error in errors[:most]]
    if len(errors) > most:
        lines.append(f"and {len(errors) - most} more; is this the right file? A script is text as in *.pcs.script\n")
    return "".join(lines)


def _count(things: Collection[object], what: str) -> str:
    return f"{len(things)} {what}{'' if len(things) == 1 else 's'}"


def _place(error: ScriptError) -> str:
    return f"{error.line}:{error.column}" if error.column else str(error.line)


def trial_text(statements: int, errors: int, violations: Sequence[str]) -> str:
    """Write the result of trying a script: a sentence, then one line for each violation.

    statements, errors: the number of statements that were read, and of errors in them.
    violations: what is not legal in the configuration to which the script leads; not written if there are errors.
    """
    if errors:
        return f"{statements} statements read, {errors} errors: nothing is done\n"
    illegal = "".join(f"not legal: {violation}\n" for violation in violations)
    return f"{statements} statements done\n{illegal}"
