"""Reads and writes files of component graphs: people write `NAME.pcs.yaml`, programs write `NAME.pcs.json`.

Both are read as strictly as a spec: everything unknown is refused, and one reading finds every mistake, with line and
column. Every mistake has the code PCS001. The sentence about a wrong name begins with `clash:K` (name K stands for two
things) or `unknown:X` (name X stands for nothing).
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from heronry_dg.findings import Finding, Findings, Place
from heronry_dg.loader import collector_at_rest, read_file
from heronry_dg.rules.rule import Rule
from heronry_pcs.file_rules import BAD_FILE
from heronry_pcs.graph import Graph, Part
from heronry_pcs.json_file import read_json
from heronry_pcs.yaml_file import read_yaml

YAML_SUFFIX: Final = ".pcs.yaml"
JSON_SUFFIX: Final = ".pcs.json"
SUFFIXES: Final = (YAML_SUFFIX, JSON_SUFFIX)

Json = dict[str, Any]


def load_graph(path: str | Path) -> Graph:
    """Load the graph in a file; raises SpecError with all that is wrong, also for a file that cannot be read."""
    found = _Found(str(path))
    data = read_file(Path(path), found)
    graph = read_graph(data, str(path), found) if data is not None else None
    if graph is None:
        raise found.error()
    return graph


def read_graph(data: bytes, file: str, findings: Findings) -> Graph | None:
    """Read a graph; None, and findings, where the data are no graph.

    A `file` that ends in .pcs.json is read as JSON.
    """
    found = _Found(file)
    with collector_at_rest():
        name = Path(file).name
        for suffix in SUFFIXES:
            name = name.removesuffix(suffix)
        graph = (read_json if file.endswith(JSON_SUFFIX) else read_yaml)(data, name, found)
    for finding in found:
        findings.add(BAD_FILE, finding.place, finding.sentence, finding.hint)
    return None if len(found) else graph


def findings_in(data: bytes, file: str) -> tuple[Finding, ...]:
    """Return all findings about the file of a graph."""
    found = _Found(file)
    read_graph(data, file, found)
    return tuple(found)


def document(graph: Graph) -> Json:
    """Return a graph as plain data: what `to_json` writes."""
    return {
        "pcs": 1,
        "name": graph.name,
        "leaves": {
            leaf.name: {"ports": dict(leaf.ports), "image": leaf.image, "plant": leaf.plant, "side": leaf.side}
            for leaf in graph.leaves.values()
        },
        "components": {name: _part(part) for name, part in graph.composites.items()},
        "graph": _part(graph.own),
    }


def to_json(graph: Graph) -> str:
    """Write a graph as a *.pcs.json file has it; the same graph gives the same bytes."""
    return json.dumps(document(graph), indent=1, ensure_ascii=False) + "\n"


def _part(part: Part) -> Json:
    return {
        "vertices": sorted(part.vertices),
        "edges": [list(edge) for edge in sorted(part.edges)],
        "components": sorted(part.components),
    }


class _Found(Findings):
    """Collects the findings about a graph file under the one code PCS001.

    The YAML reader is made for specs, so its findings name rules of specs; `add` replaces each such rule by PCS001.
    """

    def add(self, rule: Rule, place: Place, sentence: str, hint: str = "") -> None:
        """Note a mistake under PCS001; a hint that is about specs is left out."""
        del rule
        super().add(BAD_FILE, place, sentence, "" if _is_about_specs(hint.split()) else hint)


def _is_about_specs(words: Iterable[str]) -> bool:
    return any(word.strip("`;,") in ("spec", "dg:", "needs") for word in words)
