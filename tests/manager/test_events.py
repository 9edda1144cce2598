"""The one stream of events: every emitted event is as it is documented."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_manager.core.events import KINDS, VERSION, event
from lab.documents.event_table import fields_of


def test_an_event_has_version_time_and_kind_and_an_unknown_kind_is_a_defect() -> None:
    assert event("stopped", 5, reason="done") == {"v": VERSION, "t_ns": 5, "event": "stopped", "reason": "done"}
    with pytest.raises(KeyError, match="landed"):
        event("landed", 5)


# What is emitted


def emissions() -> Iterator[tuple[str, str, set[str | None]]]:
    """Place, kind and fields of every call, in manager and tools, that builds an event of a named kind."""
    for file in sorted([*Path("manager").rglob("*.py"), *Path("tools").rglob("*.py")]):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and name_of(node.func) in ("_emit", "emit", "make_event", "event"):
                kinds = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                for kind in kinds[:1]:
                    yield f"{file}:{node.lineno}", kind, {keyword.arg for keyword in node.keywords}


def name_of(function: ast.expr) -> str:
    return (
        function.attr if isinstance(function, ast.Attribute) else function.id if isinstance(function, ast.Name) else ""
    )


def test_every_event_that_is_emitted_is_documented_field_by_field() -> None:
    found = list(emissions())
    assert [one for one in found if one[1] not in KINDS] == []
    assert [(place, fields) for place, kind, fields in found if fields != set(fields_of(kind))] == []


def test_every_documented_event_is_emitted_somewhere() -> None:
    assert KINDS.keys() - {kind for _, kind, _ in emissions()} == set()
