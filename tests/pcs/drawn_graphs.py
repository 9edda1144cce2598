"""Random component graphs of up to eight components, nested, valid and not, as the reference has them.

A drawing starts from a sound nested graph and then, as often as not, breaks it in one or two places: so graphs stand
close to both sides of each predicate.
"""

from random import Random
from typing import Any

import pcs.reference as ref
from heronry_pcs.graph import Graph, Leaf, Part

PORTS = ("a", "b", "c.0")
MOST_COMPONENTS = 8


def drawn(rng: Random, names: str = "ABCDEFGH") -> ref.G:
    """Draw one graph."""
    leaves = {
        name: {
            "ports": {port: rng.choice((0, 0, 1, 2, 5)) for port in rng.sample(PORTS, rng.choice((1, 1, 2, 3)))},
            "image": rng.choice((name, "image.dll")),
            "plant": rng.random() < 0.2,
            "side": rng.choice((None, None, "left", "right")),
        }
        for name in names[: rng.choice((1, 2, 3, 4, 4, 5, 6))]
    }
    inside = [name for name in leaves if rng.random() < 0.85] or sorted(leaves)[:1]
    g: ref.G = {"leaves": leaves, "components": {}, "graph": (frozenset(), frozenset(), frozenset())}
    vertices = frozenset(v for leaf in inside for v in ref.ports(g, leaf))
    edges = drawn_edges(rng, g, sorted(vertices))
    groups = drawn_groups(rng, inside, MOST_COMPONENTS - len(inside))
    for name, group in groups.items():
        g["components"][name] = composite(g, edges, group, groups)
    g["graph"] = (vertices, edges, frozenset(inside) | frozenset(groups))
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        break_something(rng, g)
    if g["components"] and rng.random() < 0.4:
        break_composite(rng, g, rng.choice(sorted(g["components"])))
    return g


def break_composite(rng: Random, g: ref.G, name: str) -> None:
    """Break what only a composite can break, or take a leaf away that stays inside it with its vertices."""
    v, e, c = g["components"][name]
    lost = {rng.choice(sorted(c))} if c and rng.random() < 0.25 else set()
    if lost:
        v_of_g, e_of_g, c_of_g = g["graph"]
        g["graph"] = (v_of_g, e_of_g, c_of_g - lost)
        g["components"] = {k: (x[0], x[1], x[2] - lost) for k, x in g["components"].items()}
        return
    space = sorted(ref.space_vertices(g))
    edge = (rng.choice(space), rng.choice(space))
    broken = [(v, e, c | {name}), (v | {edge[0]}, e | {edge}, c), (frozenset(), frozenset(), frozenset())]
    g["components"][name] = rng.choice(broken)


def drawn_edges(rng: Random, g: ref.G, vertices: list[str]) -> frozenset[tuple[str, str]]:
    count = rng.choice((0, 1, len(vertices), len(vertices), 2 * len(vertices), 2 * len(vertices)))
    pairs = ((rng.choice(vertices), rng.choice(vertices)) for _ in range(count))
    inner = rng.random() < 0.2
    return frozenset(pair for pair in pairs if inner or ref.leaf_of(pair[0]) != ref.leaf_of(pair[1]))


def drawn_groups(rng: Random, leaves: list[str], most: int) -> dict[str, set[str]]:
    """Draw nested sets of leaves, by name of their composite: each lies inside another one, or apart."""
    tops: list[set[str]] = [{leaf} for leaf in leaves]
    groups: dict[str, set[str]] = {}
    for name in "KLM"[: min(most, rng.choice((0, 0, 0, 1, 2, 3)))]:
        joined = rng.sample(range(len(tops)), rng.randint(1, min(3, len(tops))))
        group = set[str]().union(*(tops[number] for number in joined))
        tops = [top for number, top in enumerate(tops) if number not in joined] + [group]
        groups[name] = group
    return groups


def composite(g: ref.G, edges: frozenset[tuple[str, str]], group: set[str], groups: dict[str, set[str]]) -> ref.X:
    vertices = frozenset(v for leaf in group for v in ref.ports(g, leaf))
    order = list(groups)
    own = order.index(next(name for name in order if groups[name] is group))
    below = {name for number, name in enumerate(order) if number < own and groups[name] <= group}
    inner = frozenset(e for e in edges if e[0] in vertices and e[1] in vertices)
    return (vertices, inner, frozenset(group | below))


def break_something(rng: Random, g: ref.G) -> None:
    """Change one set of the graph or of a composite by one thing, or drop it."""
    where = rng.choice(["graph", "graph", *g["components"], *g["components"]])
    v, e, c = g["graph"] if where == "graph" else g["components"][where]
    space = sorted(ref.space_vertices(g))
    match rng.randrange(9):
        case 0:
            v = v ^ {rng.choice(space)}
        case 1:
            e = e ^ {(rng.choice(space), rng.choice(space))}
        case 2:
            c = c ^ {rng.choice([*g["leaves"], *g["components"]])}
        case 3:
            c = frozenset(one for one in c if one in g["leaves"] and rng.random() < 0.9)
        case 4:
            c = frozenset(one for one in c if one not in g["leaves"])
        case 5:
            v = frozenset()
        case 6:
            e = frozenset()
        case 7:
            c = frozenset(rng.sample(sorted(c), len(c) // 2))
        case _:
            leaf = rng.choice(sorted(g["leaves"]))
            v, c = v | ref.ports(g, leaf), c | {leaf}
    if where == "graph":
        g["graph"] = (v, e, c)
    else:
        g["components"][where] = (v, e, c)


def drawn_configuration(rng: Random, names: str = "ABCDEFG") -> ref.G:
    """Draw a configuration, with leaves of the space that are not in it, and contracted members."""
    while True:
        g = drawn(rng, names)
        inside = sorted(leaf for leaf in g["leaves"] if rng.random() < 0.8) or sorted(g["leaves"])[:1]
        g["components"] = {}
        if len(inside) > 2 and rng.random() < 0.3:
            joined = inside[:2]
            inside = inside[2:]
            g["components"]["K"] = (frozenset(v for one in joined for v in ref.ports(g, one)), frozenset(), frozenset())
        held = [*inside, *g["components"]]
        edges = set()
        for number, one in enumerate(held[1:], 1):
            edges.add((some_vertex(rng, g, held[rng.randrange(number)]), some_vertex(rng, g, one)))
        for _ in range(rng.randrange(4)):
            one, other = rng.choice(held), rng.choice(held)
            if one != other:
                edges.add((some_vertex(rng, g, one), some_vertex(rng, g, other)))
        vertices = frozenset(v for one in held for v in ref.part(g, one)[0])
        g["graph"] = (vertices, frozenset(edges), frozenset(held))
        if ref.configuration(g):
            return g


def some_vertex(rng: Random, g: ref.G, name: str) -> str:
    return rng.choice(sorted(ref.part(g, name)[0]))


def as_graph(g: ref.G, name: str = "drawn") -> Graph:
    """The library's value of a reference's graph."""
    return Graph(
        name=name,
        leaves={one: Leaf(one, **fields) for one, fields in g["leaves"].items()},
        composites={one: Part(*x) for one, x in g["components"].items()},
        own=Part(*g["graph"]),
    )


def as_reference(graph: Graph) -> ref.G:
    """The reference's graph of a value of the library."""
    fields = ("ports", "image", "plant", "side")
    return {
        "leaves": {one: {field: getattr(leaf, field) for field in fields} for one, leaf in graph.leaves.items()},
        "components": {one: (x.vertices, x.edges, x.components) for one, x in graph.composites.items()},
        "graph": (graph.own.vertices, graph.own.edges, graph.own.components),
    }


def drawn_view(rng: Random, g: ref.G) -> set[str]:
    """Draw a view of a graph if it has one, and now and then something that is none."""
    tops = [k for k in ref.members(g) if not any(k in ref.part(g, other)[2] for other in ref.members(g) if other != k)]
    view = set(tops)
    for _ in range(rng.randrange(3)):
        composites = sorted(k for k in view if k not in g["leaves"])
        if composites:
            k = rng.choice(composites)
            inside = ref.part(g, k)[2]
            view = view - {k} | {one for one in inside if not any(one in ref.part(g, two)[2] for two in inside)}
    if rng.random() < 0.15:
        view ^= {rng.choice([*g["leaves"], *g["components"], "Z"])}
    return view


def answer(operation: Any, *arguments: Any) -> Any:
    """What an operation gives, or the name of its error."""
    try:
        return operation(*arguments)
    except ref.Refused as refused:
        return str(refused)
