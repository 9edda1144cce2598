"""Views: the same system in more or less detail, by contraction and expansion.

A *model* is a component graph that is whole and nested. A *view* of a model is a set of members that share no vertex
and together have all vertices. A view shows each member closed, as (its vertices, {}, {}). The edges of the view are
those that do not lie inside one of its members. Predicates are assessed in the model or in a view, loops only in the
model.

Contraction replaces the members of a view that are inside a component by that component; with `parts` it first makes a
new composite of these members. Expansion replaces a component by the largest components in it. The vertices and edges
of the model never change; its members change only where contraction makes a composite.

A predicate that holds before a contraction holds after it, too, except cycle_bound. A predicate that holds before an
expansion holds after it, too, except component_connected (hence configuration) and cycle_bound.

Source: the paper that graph.py names, sections 2.1 and 2.2 (Figures 3 to 5). The expansion in the paper's Figure 3 adds
variables that no component had; here a view adds nothing.
"""

from collections.abc import Collection
from dataclasses import replace

from heronry_pcs.graph import Graph, Part, PcsError, inside
from heronry_pcs.predicates import is_nested, need

View = frozenset[str]


def check_view(model: Graph, view: Collection[str]) -> None:
    """Raise PcsError where the graph is no model, or the members are no view of the model."""
    need(model, "component_graph", "whole", "nested")
    for name in sorted(view):
        if name not in model.members:
            raise PcsError(f"unknown:{name}", model.members)
    vertices = _vertices(model, view)
    if sum(len(model.members[name].vertices) for name in view) != len(vertices) or vertices != model.vertices:
        raise PcsError("view")


def view_graph(model: Graph, view: Collection[str]) -> Graph:
    """Return a view as a graph of its own; raises PcsError as `check_view` does.

    The components of the graph are the members of the view, each closed: without inner edges and components.
    """
    check_view(model, view)
    of = {vertex: name for name in view for vertex in model.members[name].vertices}
    return Graph(
        name=model.name,
        leaves=model.leaves,
        composites={name: Part(model.members[name].vertices) for name in sorted(view) if name not in model.leaves},
        own=Part(
            vertices=model.vertices,
            edges=frozenset(
                (start, end) for start, end in model.edges if start not in of or end not in of or of[start] != of[end]
            ),
            components=frozenset(view),
        ),
    )


def contract(
    model: Graph, view: Collection[str], name: str, parts: Collection[str] | None = None
) -> tuple[Graph, View]:
    """Replace the members of a view inside component `name` by that component; gives the model and the new view.

    parts: members of the view of which the composite `name` is made first; None: the model has component
        `name` already.

    Raises PcsError. The codes, in the order in which they are checked: those of `check_view`; only with
    `parts`: `view`, `clash:K`, `needs:nested`; then always: `unknown:K`, `contracted`.
    """
    check_view(model, view)
    if parts is not None:
        model = _with_composite(model, frozenset(view), name, frozenset(parts))
    if name not in model.members:
        raise PcsError(f"unknown:{name}", model.members)
    component = model.members[name]
    replaced = frozenset(view) & component.components
    if name in view or _vertices(model, replaced) != component.vertices:
        raise PcsError("contracted")
    return model, frozenset(view) - replaced | {name}


def _with_composite(model: Graph, view: View, name: str, parts: View) -> Graph:
    if not parts or not parts <= view:
        raise PcsError("view")
    if name in model.leaves or name in model.composites:
        raise PcsError(f"clash:{name}")
    vertices = _vertices(model, parts)
    made = Part(
        vertices=vertices,
        edges=inside(model.edges, vertices),
        components=parts.union(*(model.members[part].components for part in parts)),
    )
    composites = {
        one: _joined_by(part, name, made) if one in model.members and parts <= part.components else part
        for one, part in model.composites.items()
    }
    changed = replace(
        model,
        composites={**composites, name: made},
        own=replace(model.own, components=model.own.components | {name}),
    )
    if not is_nested(changed):
        raise PcsError("needs:nested")
    return changed


def _joined_by(part: Part, name: str, made: Part) -> Part:
    return replace(part, edges=part.edges | made.edges, components=part.components | {name})


def expand(model: Graph, view: Collection[str], name: str) -> tuple[Graph, View]:
    """Replace the member `name` of a view by the largest of its components; gives the model and the new view.

    Raises PcsError. First, `check_view` raises its errors. Then follow, in this order:

        unknown:NAME   the view has no such member
        leaf           the member has no components
        uncovered      its largest components do not have all of its vertices
    """
    check_view(model, view)
    if name not in view:
        raise PcsError(f"unknown:{name}", view)
    member = model.members[name]
    if not member.components:
        raise PcsError("leaf")
    inner = frozenset[str]().union(*(model.members[one].components for one in member.components))
    largest = member.components - inner
    if _vertices(model, largest) != member.vertices:
        raise PcsError("uncovered")
    return model, frozenset(view) - {name} | largest


def _vertices(model: Graph, names: Collection[str]) -> frozenset[str]:
    return frozenset[str]().union(*(model.members[name].vertices for name in names))
