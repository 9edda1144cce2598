"""How long component graphs take: a check and a cut of 2 000 members and 20 000 edges, blocks of 200, loops, a script.

Times are of this process alone, each with its limit. The script is the paper's Figure 16, mended, which took 10.3 ms on
a Pentium III of 700 MHz. Loops are those of a plan's graph of 100 leaves, as they are looked for after each epoch.
"""

import random
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from heronry_pcs.assessment import assess
from heronry_pcs.cycles import cycles
from heronry_pcs.graph import Graph, Leaf, Part
from heronry_pcs.graph_files import load_graph
from heronry_pcs.loops import loops
from heronry_pcs.operations import combine
from heronry_pcs.script import interpret
from heronry_pcs.shipped import shipped_graph_path
from heronry_tools.analysis.control.cut import least_cut
from heronry_tools.analysis.control.longest_cycle import longest_cycle
from lab.benches.harness import Benchmark, Report, option

_SPARSE: Final = (240, 300, 400, 600)  # edges of a block of about 200: the fewer, the harder


def drawn(members: int, edges: int, seed: int) -> Graph:
    """Draw a graph of leaves with three ports each, a third of them pinned to two sides, every fiftieth a plant."""
    rng = random.Random(seed)
    sides = ("left", "right", None, None, None, None)
    leaves = {
        f"L{n}": Leaf(
            f"L{n}", {port: rng.randrange(100_000) for port in "abc"}, "x", plant=n % 50 == 0, side=rng.choice(sides)
        )
        for n in range(members)
    }
    found: set[tuple[str, str]] = set()
    while len(found) < edges:
        start, end = rng.sample(range(members), 2)
        found.add((f"L{start}.{rng.choice('abc')}", f"L{end}.{rng.choice('abc')}"))
    vertices = frozenset(vertex for leaf in leaves.values() for vertex in leaf.vertices())
    return Graph("drawn", leaves, {}, Part(vertices, frozenset(found), frozenset(leaves)))


def measure(arguments: Namespace, report: Report) -> None:
    """Take each time `--runs` times."""
    runs: int = arguments.runs
    large = [drawn(2_000, 20_000, seed) for seed in range(runs)]
    report.times("check", [_ms(partial(assess, graph, search=longest_cycle)) for graph in large], limit=1_000)
    report.times("cut", [_ms(partial(least_cut, graph)) for graph in large], limit=3_000)
    blocks = [drawn(200, edges, seed) for seed in range(runs) for edges in _SPARSE]
    report.times("longest cycle", [_ms(partial(cycles, graph, longest_cycle)) for graph in blocks], limit=5_000)
    found = [cycles(graph, longest_cycle).longest for graph in blocks]
    report.figures("  of {blocks} blocks {proven} proven", blocks=len(found), proven=sum(a == b for a, b in found))
    report.require(all(least == most for least, most in found))
    flying = [drawn(100, 150, seed) for seed in range(runs)]
    report.times("loops", [_ms(partial(loops, graph)) for graph in flying], limit=5)
    script = Path(shipped_graph_path("g_star").with_name("g_star.pcs.script")).read_text(encoding="utf-8")
    both = combine(load_graph(shipped_graph_path("g_eav")), load_graph(shipped_graph_path("g_max")))
    report.times("Figure 16 mended", [_ms(partial(interpret, script, both)) for _ in range(10 * runs)], limit=3)


def _ms(call: Callable[[], object]) -> float:
    begun_ns = time.process_time_ns()
    call()
    return (time.process_time_ns() - begun_ns) / 1e6


main = Benchmark("component_graphs", __doc__, measure, option("--runs", 5, "graphs of each kind"))
if __name__ == "__main__":
    sys.exit(main())
