"""The kinds of events with their fields, from the data classes of `heronry_manager.events`, and the records in them."""

import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from typing import Any, get_args, get_origin, get_type_hints

from heronry_dg.plan_document import PlanDocument
from heronry_manager.events import Event, Place, Times, Waited, demo, epochs, feeds, kinds_of, managers, pes, situation
from heronry_manager.events.schema import notes
from lab.documents.markdown import code, table

_PLAIN = {str: "text", int: "integer", float: "number", bool: "true or false", types.NoneType: "null", Any: "anything"}
_RECORDS = (Times, Waited, Place)


def of_managers() -> str:
    """Return the events of a manager about itself."""
    return _table(kinds_of(managers))


def of_pes() -> str:
    """Return the events about PEs."""
    return _table(kinds_of(pes))


def of_the_situation() -> str:
    """Return the events about the situation."""
    return _table(kinds_of(situation))


def of_epochs() -> str:
    """Return the events about plans and epochs."""
    return _table(kinds_of(epochs))


def of_the_demo() -> str:
    """Return the events of the demo."""
    return _table(kinds_of(demo))


def of_feeds() -> str:
    """Return the events that a feed has in addition."""
    return _table(kinds_of(feeds))


def records() -> str:
    """Return the records that stand in fields of events."""
    rows = ([code(one.__name__), _fields(one), _meaning(one)] for one in _RECORDS)
    return table(["record", "fields", "what it tells"], rows)


def _table(kinds: Iterable[type[Event]]) -> str:
    rows = ([code(kind.KIND), _fields(kind), _meaning(kind)] for kind in kinds)
    return table(["event", "fields", "what it tells"], rows)


def _meaning(kind: type) -> str:
    return (kind.__doc__ or "").removesuffix(".")


def _fields(kind: type) -> str:
    hints, said = get_type_hints(kind), notes(kind)
    found = []
    for one in fields(kind):
        if one.name == "t_ns":
            continue
        more = ["may be left out"] if one.default is not MISSING else []
        more += [said[one.name]] if one.name in said else []
        found.append(f"{code(one.name)} ({'; '.join([words_of(hints[one.name]), *more])})")
    return ", ".join(found)


def words_of(hint: Any) -> str:
    """Say what stands in a field with this annotation."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(words_of(one) for one in inner)
    if origin is typing.Literal:
        return " or ".join(f"'{one}'" for one in inner)
    if origin is tuple and inner[-1] is Ellipsis:
        return f"list of {words_of(inner[0])}"
    if origin is tuple:
        return f"[{', '.join(words_of(one) for one in inner)}]"
    if origin is Mapping:
        return "object" if inner[1] is Any else f"object of {words_of(inner[1])}"
    if hint is PlanDocument:
        return "plan"
    return code(hint.__name__) if hint in _RECORDS else _PLAIN[hint]
