"""Messages between the planner's process and its client: one JSON object per line, in both directions.

The client sends requests; `running` is null if no running configuration is known:

    {"request": 7, "down": ["pe:nav"], "limits": {"bus:radio": "2/5"}, "phase": "glide", "priorities": {"imaging": 7},
     "running": {"autopilot": ["full", "nav"]}}

The process sends three kinds of answers:

    {"ready": true}                 once, at the start: the spec has been read
    {"request": 7, "modules": {..}, "objective": [..], "bounds": [..]}
                                    the plan found: the modules as in a plan file, ten integers (`Objective.key`), and
                                    their upper bounds
    {"request": 7, "error": TEXT}   no plan, and why; `request` is null if the request could not be read

The process inherits the spec as an open file. A line that cannot be read raises `MessageError`: a client and its own
process send such a line only because of a defect.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement
from heronry_dg.plan import LEVELS, PlanError, configuration_of, modules_json
from heronry_dg.situation import Situation, UnknownElementError, checked_element


class MessageError(ValueError):
    """A line does not follow the protocol between the planner's process and its client."""


@dataclass(frozen=True, slots=True)
class Request:
    """A request for a plan: the situation, and the running configuration (None: none is known)."""

    number: int
    now: Situation
    running: Placement | None


@dataclass(frozen=True, slots=True)
class Ready:
    """The first line that the planner's process sends: it has read the spec, and waits for requests."""


@dataclass(frozen=True, slots=True)
class Solution:
    """The best configuration found, its objective, and the proven upper bounds.

    bounds: one for each integer of the objective's key.
    """

    number: int
    configuration: Configuration
    objective: Objective
    bounds: tuple[int, ...]  # upper bound of each integer of the objective's key


@dataclass(frozen=True, slots=True)
class Refusal:
    """The answer if there is no plan; `number` is None if the request could not be read."""

    number: int | None
    reason: str


Answer = Ready | Solution | Refusal


def request_line(request: Request) -> bytes:
    """Encode a request as one line for the planner's process."""
    return _line(
        {
            "request": request.number,
            "down": sorted(request.now.down),
            "limits": {element: str(share) for element, share in request.now.limits.items()},
            "phase": request.now.phase,
            "priorities": dict(request.now.priorities),
            "running": None if request.running is None else {m: list(at) for m, at in request.running.items()},
        }
    )


def answer_line(answer: Answer) -> bytes:
    """Encode an answer."""
    match answer:
        case Ready():
            return _line({"ready": True})
        case Solution(number, configuration, objective, bounds):
            modules = modules_json(configuration)
            return _line({"request": number, "modules": modules, "objective": objective.key(), "bounds": bounds})
        case Refusal(refused, reason):
            return _line({"request": refused, "error": reason})


def read_request(line: bytes, spec: Spec) -> Request:
    """Decode a request about a spec; raises MessageError."""
    match _fields(line):
        case {
            "request": int(number),
            "down": list(down),
            "limits": dict(limits),
            "phase": str() | None as phase,
            "priorities": dict(priorities),
            "running": dict() | None as running,
        }:
            return Request(number, _situation(spec, down, limits, phase, priorities), _placement(running))
        case other:
            raise _no_request(other)


def _situation(
    spec: Spec, down: list[str], limits: dict[str, str], phase: str | None, priorities: dict[str, int]
) -> Situation:
    if phase is not None and phase not in spec.phases:
        raise _no_request(f"no phase is named '{phase}'")
    if not all(isinstance(text, str) for text in (*down, *limits.values())):
        raise _no_request("an element or a limit is not a string")
    if not all(name in spec.functions and isinstance(n, int) for name, n in priorities.items()):
        raise _no_request("a priority names no function, or is not an integer")
    try:
        return Situation(
            down=frozenset(checked_element(spec, element) for element in down),
            limits={checked_element(spec, element): Fraction(share) for element, share in limits.items()},
            phase=phase,
            priorities=priorities,
        )
    except (UnknownElementError, ValueError, ZeroDivisionError) as error:
        raise _no_request(error) from error


def _placement(running: dict[str, list[str]] | None) -> Placement | None:
    try:
        return None if running is None else {module: (mode, pe) for module, (mode, pe) in running.items()}
    except (ValueError, TypeError) as error:
        raise _no_request(f"'running' is not {{module: [mode, PE]}} ({error})") from error


def _no_request(reason: object) -> MessageError:
    return MessageError(f"the request for a plan cannot be read: {reason}")


def read_answer(line: bytes) -> Answer:
    """Decode an answer; raises MessageError."""
    fields = _fields(line)
    match fields:
        case {"ready": True}:
            return Ready()
        case {"request": int(number), "modules": dict(), "objective": list(objective), "bounds": list(bounds)}:
            return _solution(number, fields, objective, bounds)
        case {"request": int() | None as refused, "error": str(reason)}:
            return Refusal(refused, reason)
        case other:
            raise _no_answer(other)


def _solution(number: int, fields: dict[str, object], objective: list[int], bounds: list[int]) -> Solution:
    if not len(objective) == len(bounds) == len(LEVELS) or not all(isinstance(one, int) for one in objective + bounds):
        raise _no_answer(f"its objective and its bounds must be {len(LEVELS)} integers each")
    try:
        return Solution(number, configuration_of(fields), Objective.of_key(objective), tuple(bounds))
    except PlanError as error:
        raise _no_answer(error) from error


def _no_answer(reason: object) -> MessageError:
    return MessageError(f"the planner's answer is not valid: {reason}")


def _line(fields: Mapping[str, object]) -> bytes:
    return json.dumps(fields, ensure_ascii=True).encode() + b"\n"


def _fields(line: bytes) -> dict[str, object]:
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"a line between manager and planner is not a JSON object: {error}") from error
    if not isinstance(fields, dict):
        raise MessageError("a line between manager and planner is not a JSON object")
    return fields
