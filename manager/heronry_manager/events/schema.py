"""The JSON schema of a line of the stream, made from the data classes of the events.

The file events.schema.json in this folder has the same text, for programs in other languages.
"""

import json
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter

from heronry_manager.events import KINDS, VERSION, Event

SCHEMA_FILE = Path(__file__).with_name("events.schema.json")


def schema_text() -> str:
    """Write the schema of this version's events (draft 2020-12)."""
    kinds: list[tuple[str, Any, TypeAdapter[Any]]] = [
        (kind, "serialization", TypeAdapter(one)) for kind, one in KINDS.items()
    ]
    places, made = TypeAdapter.json_schemas(kinds)
    defined = made["$defs"]
    for (kind, _), place in places.items():
        name = place["$ref"].rpartition("/")[2]
        defined[name] = _of_line(KINDS[str(kind)], defined[name])
    whole = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"heronry event, version {VERSION}",
        "description": "One line of the stream of events.",
        "oneOf": list(places.values()),
        "$defs": defined,
    }
    return json.dumps(whole, indent=2) + "\n"


def _of_line(kind: type[Event], made: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of a kind's lines, from that of its data class: with version and kind, and with the notes."""
    own = {one.name: {**made["properties"][one.name]} for one in fields(kind)}
    for name, note in notes(kind).items():
        own[name]["description"] = note
    head = {"v": {"const": VERSION}, "t_ns": own.pop("t_ns"), "event": {"const": kind.KIND}}
    required = [one.name for one in fields(kind) if one.default is MISSING and one.name != "t_ns"]
    return {
        "type": "object",
        "description": made["description"],
        "properties": {**head, **own},
        "required": [*head, *required],
    }


def notes(kind: type) -> dict[str, str]:
    """Return the notes on the fields of a data class, by name, where there is one."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}
