"""The assessment of a graph, or of a view of one, as the plain data that `heronry pcs check --json` writes.

Predicates, neighbors, and the necessary conditions for control are assessed in the view. Loops are assessed in the
model, which is the graph that the view shows in less detail.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

from heronry_pcs.cycles import Search, bounds_alone, cycles
from heronry_pcs.graph import Graph, PcsError
from heronry_pcs.loops import is_plant, loops
from heronry_pcs.neighborhood import controllable, neighbors, observable, subsumed
from heronry_pcs.predicates import PREDICATES, broken
from heronry_pcs.views import view_graph

NOT_SUFFICIENT: Final = "necessary, not sufficient"
"""The note that every output shows beside its statements about controllability and observability."""

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Assessment:
    """The result of assessing a graph: what holds of the graph, in JSON form (`document`)."""

    document: Json

    def holds(self, predicate: str, plants: Collection[str] | None = None) -> bool:
        """Tell whether a predicate is known to hold.

        plants: used only for `on_path`: the plants that must each be on a path. None: all plants that are members of
            the view. Plants that are not members of the view are ignored.
        """
        if predicate != "on_path":
            return self.document.get(predicate) is True
        members = self.document["components"].items()
        return not any(facts.get("on_path") is False for name, facts in members if plants is None or name in plants)


def assess(
    model: Graph,
    view: Collection[str] | None = None,
    path: Collection[str] | None = None,
    search: Search = bounds_alone,
) -> Assessment:
    """Assess a graph, or a view of it.

    view: the members of the view; None: the graph itself is assessed.
    path: members through which one loop must lead; None: this is not assessed.
    search: finds bounds of the longest cycle; by default bounds that need no search.
    Raises PcsError where `view` is no view of the graph, or `path` has a name that is no member.
    """
    seen = model if view is None else view_graph(model, view)
    document: Json = {name: holds(seen) for name, holds in PREDICATES.items()}
    found = cycles(seen, search)
    document["broken"] = broken(seen)
    document["longest_cycle"] = list(found.longest)
    document["cycle_bound"] = found.cycle_bound
    all_loops = loops(model)
    if path is not None:
        document["control_path"] = all_loops.join([_member(model, name) for name in sorted(path)])
    facts = neighbors(seen), subsumed(seen), controllable(seen), observable(seen)
    document["components"] = {
        name: {
            "neighbors": sorted(facts[0][name]),
            "subsumes": facts[1][name],
            "controllable": facts[2][name],
            "observable": facts[3][name],
            "on_loop": all_loops.through(member.vertices),
            **({"on_path": all_loops.control(member.vertices)} if is_plant(seen, name) else {}),
        }
        for name, member in seen.members.items()
    }
    return Assessment(document)


def _member(model: Graph, name: str) -> frozenset[str]:
    if name not in model.members:
        raise PcsError(f"unknown:{name}", model.members)
    return model.members[name].vertices
