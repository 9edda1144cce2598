"""An event as a line of JSON: `v`, `t_ns`, `event` (its kind), and its fields in the order of their declaration."""

import json
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import cache
from typing import Any

from heronry_dg.plan_document import plain
from heronry_manager.events import KINDS, VERSION, Event, UnknownEvent


def to_line(event: Event) -> str:
    """Encode an event as one line of JSON, without its line break."""
    return _encoded(_object(event))


def to_object(event: Event) -> dict[str, Any]:
    """Return the JSON object of an event as plain data."""
    return {key: plain(value) for key, value in _object(event).items()}


_encoded: Callable[[Any], str] = json.JSONEncoder(separators=(",", ":"), default=plain).encode


def _object(event: Event) -> dict[str, Any]:
    head = {"v": VERSION, "t_ns": event.t_ns, "event": event.kind}
    if isinstance(event, UnknownEvent):
        return {**head, **event.data}
    always, sometimes = _names(event.KIND)
    for name in always:
        head[name] = getattr(event, name)
    for name, default in sometimes:
        value = getattr(event, name)
        if value != default:
            head[name] = value
    return head


@cache
def _names(kind: str) -> tuple[tuple[str, ...], tuple[tuple[str, object], ...]]:
    """Return the fields that every line of a kind has, and those that a line has unless they have their default."""
    own = [one for one in fields(KINDS[kind]) if one.name != "t_ns"]
    always = tuple(one.name for one in own if one.default is MISSING)
    return always, tuple((one.name, one.default) for one in own if one.default is not MISSING)
