"""The events of the manager and of `heronry demo`, with their fields, from the list in the manager's core."""

import re

from heronry_manager.core.events import KINDS
from lab.documents.markdown import code, table

_ENTRY = re.compile(r"(?P<fields>(?:[^:({]|\([^)]*\)|\{[^}]*\})+): (?P<meaning>.+)")
_FIELD = re.compile(r"(?P<name>\w+)(?P<note> \([^)]*\)| \{[^}]*\})?(?:, |$)")


def events() -> str:
    """Give every kind of event, its fields, and what it tells."""
    rows = []
    for kind in KINDS:
        fields = ", ".join(f"{code(name)}{note}" for name, note in fields_of(kind).items())
        rows.append([code(kind), fields, _entry(kind)["meaning"]])
    return table(["event", "fields", "what it tells"], rows)


def fields_of(kind: str) -> dict[str, str]:
    """Give the fields of a kind of event, each with the note on its values, or an empty text."""
    return {field["name"]: field["note"] or "" for field in _FIELD.finditer(_entry(kind)["fields"])}


def _entry(kind: str) -> re.Match[str]:
    entry = _ENTRY.fullmatch(KINDS[kind])
    if entry is None:
        raise ValueError(f"write the event {kind} as 'fields: what it tells', not as '{KINDS[kind]}'")
    return entry
