"""A second opinion on component graphs: every definition spelt out by enumeration, for graphs of a few components.

It shares nothing with heronry_pcs. A graph is what a *.pcs.json file says, with sets instead of lists: `leaves` and
`components` (the composites) by name, and `graph`; the latter two are triples (vertices, edges, names of components).
It is slow on purpose: paths, cycles and loops are enumerated where the library walks a graph once.
"""

from collections.abc import Iterator
from itertools import combinations, pairwise, permutations
from typing import Any

X = tuple[frozenset[str], frozenset[tuple[str, str]], frozenset[str]]
G = dict[str, Any]

CONDITIONS = ("subgraph", "edge_containment", "component_containment", "monotonicity", "vertex")


class Refused(Exception):  # noqa: N818 - what an operation answers
    """An operation's error; its text is the error's name."""


def ports(g: G, leaf: str) -> frozenset[str]:
    return frozenset(f"{leaf}.{port}" for port in g["leaves"][leaf]["ports"])


def leaf_of(vertex: str) -> str:
    return vertex[: vertex.index(".")]


def space_vertices(g: G) -> frozenset[str]:
    return frozenset(v for leaf in g["leaves"] for v in ports(g, leaf))


def part(g: G, name: str) -> X:
    if name in g["leaves"]:
        return (ports(g, name), frozenset(), frozenset())
    found: X = g["components"][name]
    return found


def members(g: G) -> list[str]:
    return sorted(g["graph"][2])


def subgraph(a: X, b: X) -> bool:
    return a[0] <= b[0] and a[1] <= b[1] and a[2] <= b[2]


# Section 1: predicates.


def broken(g: G) -> dict[str, list[str]]:
    found = {}
    for k in members(g):
        v, e, c = part(g, k)
        kept = {
            "subgraph": subgraph((v, e, c), g["graph"]),
            "edge_containment": all(s in v and t in v for s, t in e),
            "component_containment": all(subgraph(part(g, one), (v, e, c)) for one in c),
            "monotonicity": k not in c,
            "vertex": len(v) > 0,
        }
        if not all(kept.values()):
            found[k] = [name for name in CONDITIONS if not kept[name]]
    return found


def component_graph(g: G) -> bool:
    return broken(g) == {}


def edge_contained(g: G) -> bool:
    v, e, _ = g["graph"]
    return all(s in v and t in v for s, t in e)


def whole(g: G) -> bool:
    sets = [g["graph"][0], *(part(g, k)[0] for k in members(g))]
    return all(ports(g, leaf) & v in (frozenset(), ports(g, leaf)) for v in sets for leaf in g["leaves"])


def nested(g: G) -> bool:
    for a, b in combinations(members(g), 2):
        apart = not part(g, a)[0] & part(g, b)[0]
        if not (apart or a in part(g, b)[2] or b in part(g, a)[2]):
            return False
    return True


def disjoint(g: G) -> bool:
    return all(sum(v in part(g, k)[0] for k in members(g)) == 1 for v in g["graph"][0])


def pruned(g: G) -> bool:
    for s, t in g["graph"][1]:
        holders = [{v for v in (s, t) if v in part(g, k)[0]} for k in members(g)]
        if {v for held in holders for v in held} != {s, t}:
            return False
        if any(held == {s, t} for held in holders):
            return False
    return True


def neighbors(g: G, a: str, b: str) -> bool:
    if a == b:
        return False
    va, vb = part(g, a)[0], part(g, b)[0]
    return any((s in va and t in vb) or (s in vb and t in va) for s, t in g["graph"][1])


def joined(g: G, a: str, b: str) -> bool:
    """Tell whether a component-path joins two members: enumerated, longest first given up."""
    others = [k for k in members(g) if k not in (a, b)]
    for n in range(len(others) + 1):
        for between in permutations(others, n):
            path = (a, *between, b)
            if all(neighbors(g, one, two) for one, two in pairwise(path)):
                return True
    return False


def component_connected(g: G) -> bool:
    """A component-path between any two: by spreading from each, since enumeration (`joined`) takes too long here."""
    for a in members(g):
        reached = {a}
        while more := {k for k in members(g) if k not in reached and any(neighbors(g, k, r) for r in reached)}:
            reached |= more
        if reached != set(members(g)):
            return False
    return True


def configuration(g: G) -> bool:
    return (
        len(g["graph"][0]) > 0
        and component_graph(g)
        and edge_contained(g)
        and whole(g)
        and disjoint(g)
        and pruned(g)
        and component_connected(g)
    )


def subsumes(g: G) -> set[tuple[str, str]]:
    """The least relation of all components, members or not, by repetition until nothing is added."""
    names = sorted({*g["leaves"], *g["components"]})
    found: set[tuple[str, str]] = set()
    while True:
        more = {
            (a, b)
            for a in names
            for b in names
            if (a, b) not in found
            and subgraph(part(g, b), part(g, a))
            and (b in part(g, a)[2] or any((one, b) in found for one in part(g, a)[2]))
        }
        if not more:
            return found
        found |= more


def cycles(g: G) -> Iterator[tuple[str, ...]]:
    """Every component-cycle, once per set of members and order from its first."""
    names = members(g)
    touching = {(a, b) for a in names for b in names if neighbors(g, a, b)}

    def extended(path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        if len(path) >= 3 and (path[-1], path[0]) in touching:
            yield path
        for name in names:
            if name > path[0] and name not in path and (path[-1], name) in touching:
                yield from extended((*path, name))

    for name in names:
        yield from extended((name,))


def longest_cycle(g: G) -> int:
    return max((len(cycle) for cycle in cycles(g)), default=0)


def cycle_bound(g: G) -> bool:
    if not component_connected(g):
        return False
    found = {frozenset(cycle) for cycle in cycles(g)}
    most = max((len(cycle) for cycle in found), default=0)
    return any(
        all(any(k in other and other & best for other in found) or k in best for k in members(g))
        for best in found
        if len(best) == most
    )


PREDICATES = {
    "component_graph": component_graph,
    "edge_contained": edge_contained,
    "whole": whole,
    "nested": nested,
    "disjoint": disjoint,
    "pruned": pruned,
    "component_connected": component_connected,
    "configuration": configuration,
    "cycle_bound": cycle_bound,
}


# Section 1: homes and loops.


def home(g: G, v: str) -> str:
    holding = [k for k in members(g) if v in part(g, k)[0]]
    return min(holding, key=lambda k: (len(part(g, k)[0]), len(part(g, k)[2]), k), default=leaf_of(v))


def loops(g: G) -> list[frozenset[str]]:
    """Pairs of homes that reach each other: every loop consists of such pairs."""
    edges = {(home(g, s), home(g, t)) for s, t in g["graph"][1]}
    homes = sorted({one for edge in edges for one in edge} | {home(g, v) for v in g["graph"][0]})
    reach = set(edges)
    while more := {(a, d) for a, b in reach for c, d in reach if b == c} - reach:
        reach |= more
    return [frozenset({a, b}) for a, b in combinations(homes, 2) if (a, b) in reach and (b, a) in reach]


def within(g: G, one: str, vertices: frozenset[str]) -> bool:
    return part(g, one)[0] <= vertices


def is_plant(g: G, name: str) -> bool:
    v = part(g, name)[0]
    return len(v) > 0 and all(g["leaves"][leaf_of(x)]["plant"] for x in v)


def on_loop(g: G, k: str) -> bool:
    v = part(g, k)[0]
    return any({within(g, one, v) for one in loop} == {True, False} for loop in loops(g))


def on_path(g: G, p: str) -> bool:
    v = part(g, p)[0]
    return any(
        any(within(g, one, v) for one in loop) and any(not is_plant(g, one) for one in loop) for loop in loops(g)
    )


def control_path(g: G, names: list[str]) -> bool:
    pairs = loops(g)
    homes = {one for pair in pairs for one in pair}
    for start in homes:
        loop = {start} | {one for pair in pairs if start in pair for one in pair}
        if all(any(within(g, one, part(g, name)[0]) for one in loop) for name in names):
            return True
    return False


# Section 2: views.


def need(g: G, *predicates: str) -> None:
    for name in predicates:
        if not PREDICATES[name](g):
            raise Refused(f"needs:{name}")


def check_view(g: G, s: set[str]) -> None:
    need(g, "component_graph", "whole", "nested")
    for name in sorted(s):
        if name not in g["graph"][2]:
            raise Refused(f"unknown:{name}")
    if any(part(g, a)[0] & part(g, b)[0] for a, b in combinations(s, 2)):
        raise Refused("view")
    if frozenset(v for name in s for v in part(g, name)[0]) != g["graph"][0]:
        raise Refused("view")


def seen(g: G, s: set[str]) -> G:
    """The view as a graph of its own."""
    check_view(g, s)
    v, e, _ = g["graph"]
    edges = frozenset(x for x in e if not any(x[0] in part(g, k)[0] and x[1] in part(g, k)[0] for k in s))
    closed: dict[str, X] = {k: (part(g, k)[0], frozenset(), frozenset()) for k in s if k not in g["leaves"]}
    return {**g, "components": closed, "graph": (v, edges, frozenset(s))}


def contract(g: G, s: set[str], k: str, parts: set[str] | None = None) -> tuple[G, set[str]]:
    check_view(g, s)
    if parts is not None:
        if not parts or not parts <= s:
            raise Refused("view")
        if k in g["leaves"] or k in g["components"]:
            raise Refused(f"clash:{k}")
        g = with_composite(g, k, parts)
        if not nested(g):
            raise Refused("needs:nested")
    if k not in g["graph"][2]:
        raise Refused(f"unknown:{k}")
    inside = {one for one in s if one in part(g, k)[2]}
    if k in s or frozenset(v for one in inside for v in part(g, one)[0]) != part(g, k)[0]:
        raise Refused("contracted")
    return g, s - inside | {k}


def with_composite(g: G, k: str, parts: set[str]) -> G:
    v = frozenset(x for one in parts for x in part(g, one)[0])
    e = frozenset(x for x in g["graph"][1] if x[0] in v and x[1] in v)
    c = frozenset(parts) | frozenset(x for one in parts for x in part(g, one)[2])
    components = {k: (v, e, c)}
    for name, (nv, ne, nc) in g["components"].items():
        joins = name in g["graph"][2] and parts <= nc
        components[name] = (nv, ne | e, nc | {k}) if joins else (nv, ne, nc)
    gv, ge, gc = g["graph"]
    return {**g, "components": components, "graph": (gv, ge, gc | {k})}


def expand(g: G, s: set[str], k: str) -> tuple[G, set[str]]:
    check_view(g, s)
    if k not in s:
        raise Refused(f"unknown:{k}")
    inside = part(g, k)[2]
    if not inside:
        raise Refused("leaf")
    largest = {one for one in inside if not any(one in part(g, other)[2] for other in inside)}
    if frozenset(v for one in largest for v in part(g, one)[0]) != part(g, k)[0]:
        raise Refused("uncovered")
    return g, s - {k} | largest


# Section 3: operations.


def cprune(g: G) -> G:
    need(g, "component_graph", "disjoint", "pruned")
    v, e, c = g["graph"]
    while len(c) >= 2:
        here = {**g, "graph": (v, e, c)}
        alone = [k for k in sorted(c) if not any(neighbors(here, k, other) for other in c)]
        if not alone:
            break
        v, c = v - part(g, alone[0])[0], c - {alone[0]}
    return {**g, "graph": (v, e, c)}


def combine(g: G, h: G, e: tuple[str, str] | None) -> G:
    for one in (g, h):
        need(one, "component_graph")
        if not one["graph"][0]:
            raise Refused("needs:vertex")
    for name in sorted(g["leaves"].keys() & h["leaves"].keys()):
        if g["leaves"][name] != h["leaves"][name]:
            raise Refused(f"clash:{name}")
    named = [
        name
        for name in sorted({*g["leaves"], *g["components"]} & {*h["leaves"], *h["components"]})
        if not (name in g["leaves"] and name in h["leaves"])
        and (name in g["leaves"] or name in h["leaves"] or g["components"][name] != h["components"][name])
    ]
    if named:
        raise Refused(f"clash:{named[0]}")
    if e is not None:
        for v in e:
            if v not in space_vertices(g) | space_vertices(h):
                raise Refused(f"unknown:{v}")
        gv, hv = g["graph"][0], h["graph"][0]
        if not ((e[0] in gv and e[1] in hv) or (e[0] in hv and e[1] in gv)):
            raise Refused("edge_apart")
    united = tuple(one | other for one, other in zip(g["graph"], h["graph"], strict=True))
    extra = frozenset({e}) if e is not None else frozenset()
    return {
        "leaves": {**g["leaves"], **h["leaves"]},
        "components": {**g["components"], **h["components"]},
        "graph": (united[0], united[1] | extra, united[2]),
    }


def removal(g: G, edges: set[tuple[str, str]]) -> G:
    need(g, "configuration")
    for edge in sorted(edges):
        known(g, edge)
    v, e, c = g["graph"]
    return cprune({**g, "graph": (v, e - edges, c)})


def known(g: G, e: tuple[str, str]) -> None:
    for v in e:
        if v not in space_vertices(g):
            raise Refused(f"unknown:{v}")


def inside_one(g: G, e: tuple[str, str]) -> bool:
    return any(set(e) <= part(g, k)[0] for k in members(g))


def addition(g: G, e: tuple[str, str]) -> G:
    need(g, "configuration")
    known(g, e)
    v, edges, c = g["graph"]
    if not set(e) <= v:
        raise Refused("edge_outside")
    if inside_one(g, e):
        raise Refused("edge_inside")
    return {**g, "graph": (v, edges | {e}, c)}


def add_edge(g: G, e: tuple[str, str]) -> G:
    need(g, "configuration")
    known(g, e)
    v = g["graph"][0]
    if not set(e) & v:
        raise Refused("edge_apart")
    for end in (e[1], e[0]):
        if end not in v:
            leaf = leaf_of(end)
            alone: G = {
                "leaves": {leaf: g["leaves"][leaf]},
                "components": {},
                "graph": (ports(g, leaf), frozenset(), frozenset({leaf})),
            }
            return combine(g, alone, e)
    if inside_one(g, e):
        return g
    return addition(g, e)


# Section 4: necessary for control.


def controllable(g: G, k: str) -> str:
    v = part(g, k)[0]
    enters = any(t in v and any(s in part(g, other)[0] for other in members(g) if other != k) for s, t in g["graph"][1])
    return "possible" if enters else "excluded"


def observable(g: G, k: str) -> str:
    v = part(g, k)[0]
    leaves = any(s in v and any(t in part(g, other)[0] for other in members(g) if other != k) for s, t in g["graph"][1])
    return "possible" if leaves else "excluded"


# Section 8: the cut.


def cut(g: G, first: str | None = None) -> tuple[int, dict[str, list[str]]]:
    """The least cut by trying every partition; of several the one in which the first side keeps most leaves."""
    v, edges, _ = g["graph"]
    nodes = [n for n, leaf in g["leaves"].items() if ports(g, n) & v and not leaf["plant"]]
    pinned = {n: g["leaves"][n]["side"] for n in nodes if g["leaves"][n]["side"] is not None}
    sides = list(dict.fromkeys(pinned.values()))
    if len(sides) != 2:
        raise Refused("sides")
    if first is not None:
        sides.sort(key=lambda side: side != first)
    free = [n for n in nodes if n not in pinned]
    best: tuple[int, int, set[str]] | None = None
    for count in range(len(free) + 1):
        for chosen in combinations(free, count):
            here = {n for n in nodes if pinned.get(n) == sides[0]} | set(chosen)
            cost = 0
            for s in {s for s, _ in edges}:
                origin, _, port = s.partition(".")
                readers = {leaf_of(t) for x, t in edges if x == s and leaf_of(t) in nodes}
                if origin in nodes and any((origin in here) != (reader in here) for reader in readers):
                    cost += g["leaves"][origin]["ports"][port]
            if best is None or (cost, -len(here)) < (best[0], -best[1]):
                best = (cost, len(here), here)
    assert best is not None
    return best[0], {sides[0]: sorted(best[2]), sides[1]: sorted(set(nodes) - best[2])}
