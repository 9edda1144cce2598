"""The difference between two snapshots, as JSON for a page.

A page first gets a whole snapshot. After that it gets only what differs from the snapshot before:

    {"set": {"phase": ...}, "merge": {"pes": {"nav": ...}}, "graph": {"nodes": {...}}, "told": [...]}

    set                whole keys of the snapshot, with their new values
    merge              single entries of the mappings `pes`, `buses`, `functions`, `modules` and `plants`
    graph              single entries of the graph's mappings `nodes`, `cells` and `edges`
    told,              the entries that are new or different, each with its `number`. The page keeps as many entries as
    reconfigurations   a snapshot does

`stream` adds the key `loads`: new loads of the buses, for the charts of the page.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import Any, Final

from heronry_tools.watch.snapshot import Graph, Snapshot

Document = dict[str, Any]

_MERGED: Final = ("pes", "buses", "functions", "modules", "plants")
_NUMBERED: Final = ("reconfigurations", "told")
_GRAPH: Final = ("nodes", "cells", "edges")


def plain(value: Any) -> Any:
    """Return a part of a snapshot as plain data."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [plain(one) for one in value]
    return value


def change(before: Snapshot, after: Snapshot) -> Document:
    """Return the difference that leads from the snapshot `before` to the snapshot `after`."""
    found: Document = {"set": {}, "merge": {}, "graph": {}}
    for field in fields(Snapshot):
        name = field.name
        old, new = getattr(before, name), getattr(after, name)
        if old is new or old == new:
            continue
        if name == "graph":
            found["graph"] = _graph_change(old, new)
        elif name in _NUMBERED:
            found[name] = _numbered_change(old, new)
        elif name in _MERGED and old.keys() == new.keys():
            found["merge"][name] = _entries(old, new)
        else:
            found["set"][name] = plain(new)
    return found


def _entries(old: Mapping[str, Any], new: Mapping[str, Any]) -> Document:
    return {key: plain(one) for key, one in new.items() if one is not old.get(key) and one != old.get(key)}


def _graph_change(old: Graph, new: Graph) -> Document:
    parts = {part: _entries(getattr(old, part), getattr(new, part)) for part in _GRAPH}
    return {part: entries for part, entries in parts.items() if entries}


def _numbered_change(old: Sequence[Any], new: Sequence[Any]) -> list[Any]:
    known = {one.number: one for one in old}
    return [plain(one) for one in new if one is not known.get(one.number) and one != known.get(one.number)]
