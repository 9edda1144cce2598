"""Reads a line of the stream: the event of its kind, or one sentence that says what is wrong with the line.

A recording may be damaged, and may come from a later version. An event of a kind that this version does not know is an
`UnknownEvent`, and a field that it does not know is left out.
"""

import json
import math
from collections.abc import Iterable, Iterator
from functools import cache

from pydantic import TypeAdapter, ValidationError

from heronry_manager.events import KINDS, Event, UnknownEvent
from heronry_wire.frame import Malformed

_MOST, _MOST_DIGITS = 1 << 63, 20


def read_event(line: str | bytes) -> Event | Malformed:
    """Read one line; whatever it holds, nothing is raised."""
    try:
        found = json.loads(line, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    except _NumberError:
        return Malformed("the line has a number that is too large")
    except (ValueError, RecursionError):
        return Malformed("the line is not JSON")
    if not isinstance(found, dict):
        return Malformed("the line is no JSON object")
    kind, t_ns = found.get("event"), found.get("t_ns")
    if not isinstance(kind, str):
        return Malformed("the line names no kind of event ('event')")
    if type(t_ns) is not int:
        return Malformed(f"event {kind}: 't_ns' is no time in whole nanoseconds")
    if kind not in KINDS:
        return UnknownEvent(t_ns, kind, {key: one for key, one in found.items() if key not in ("v", "t_ns", "event")})
    try:
        return _adapter(kind).validate_json(line, strict=True)
    except ValidationError as error:
        return Malformed(_sentence(kind, error))


def events_in(lines: Iterable[str | bytes]) -> Iterator[Event]:
    """Read lines, and leave out those that hold no event."""
    for line in lines:
        event = read_event(line)
        if not isinstance(event, Malformed):
            yield event


class _NumberError(ValueError):
    """A number of a line is too large, or none."""


def _whole(text: str) -> int:
    """Read a whole number; raises _NumberError for one that 64 bits do not hold: none of ours is so large."""
    if len(text) <= _MOST_DIGITS and -_MOST <= int(text) < _MOST:
        return int(text)
    raise _NumberError


def _finite(text: str) -> float:
    """Read a number; raises _NumberError for one that is none, or infinite."""
    number = float(text)
    if not math.isfinite(number):
        raise _NumberError
    return number


@cache
def _adapter(kind: str) -> TypeAdapter[Event]:
    """Make what reads the events of a kind; that is slow, so it is done at the first line of this kind."""
    return TypeAdapter(KINDS[kind])


def _sentence(kind: str, error: ValidationError) -> str:
    """Say what is wrong with the first field that is wrong."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(map(str, first["loc"]))
    if first["type"] == "missing":
        return f"event {kind}: '{place}' is missing"
    return f"event {kind}: '{place}': {first['msg'][0].lower()}{first['msg'][1:]}"
