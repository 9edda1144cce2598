"""Messages between an operator's command and a running manager: one JSON object a line, in both directions.

    {"v": 1, "do": "status"}                        {"v": 1, "done": true, "sentence": "", "status": {...}}
    {"v": 1, "do": "phase", "what": "glide"}        {"v": 1, "done": true, "sentence": "the phase is glide from now on"}
    {"v": 1, "do": "priority", "what": "imaging", "to": 90}          to: null for the priority of the spec
    {"v": 1, "do": "fail", "what": "pe:nav"}        {"v": 1, "done": false, "sentence": "no PE is named 'nav'; ...",
                                                     "unusable": true}      what the order names is not in the spec
    {"v": 1, "do": "clear", "what": "device:gps"}
    {"v": 1, "do": "retire", "what": "pe:nav"}                      "restore" takes the element back
    {"v": 1, "do": "unlock", "what": "pe:nav"}
    {"v": 1, "do": "traceback", "what": "module:autopilot"}     {"v": 1, "done": true, "sentence": "Traceback ..."}
    {"v": 1, "do": "script", "what": "Guav.PruneEdges ();"}         the text of a script of component graphs
    {"v": 1, "do": "reload", "what": "/etc/uav.dg.yaml", "digest": "5f3a..."}     the digest that the operator was shown
    {"v": 1, "do": "ready", "what": "/etc/uav.dg.yaml", "digest": "5f3a..."}      for a standby manager: see `Reload`
    {"v": 1, "do": "release"}                                       the script that is held
    {"v": 1, "do": "follow"}                        a status, then every event: see `followers`

Every request but `follow` has one reply, in the order of the requests. A line that is no request gets a reply that says
so.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from heronry_manager.core.vocabulary import (
    AskStatus,
    AskTraceback,
    ClearElement,
    EnterPhase,
    FailElement,
    ReleaseTarget,
    RestoreElement,
    RetireElement,
    SetPriority,
    UnlockPe,
)

VERSION = 1
LONGEST_ORDER_BYTES = 65536  # a script of a thousand lines


@dataclass(frozen=True, slots=True)
class FlyScript:
    """Order of the operator: apply a script of component graphs to the running configuration, and fly the result.

    text: the script. `script_orders` computes the configuration from it.
    """

    text: str


@dataclass(frozen=True, slots=True)
class Reload:
    """Order of the operator: fly by the spec in a file of the manager's computer; `digest`: of the spec that is meant.

    An empty digest means whatever is in the file. With `for_standby` nothing changes now: the manager has the spec at
    hand, and follows, when it stands by and the aircraft changes to that spec.
    """

    file: str
    digest: str = ""
    for_standby: bool = False


@dataclass(frozen=True, slots=True)
class Follow:
    """Request to read the manager's events from now on; what the caller sends afterwards is ignored."""


Question = AskStatus | AskTraceback
OfElement = FailElement | ClearElement | RetireElement | RestoreElement | UnlockPe
Spoken = EnterPhase | SetPriority | OfElement | FlyScript | Reload | ReleaseTarget | Question
"""The orders and questions that a request can hold: those of the core, but a script is text, another spec a file."""

WITH_WHAT: Mapping[str, type[EnterPhase | OfElement | FlyScript | AskTraceback]] = {
    "phase": EnterPhase,
    "fail": FailElement,
    "clear": ClearElement,
    "retire": RetireElement,
    "restore": RestoreElement,
    "unlock": UnlockPe,
    "traceback": AskTraceback,
    "script": FlyScript,
}
"""The orders and questions that have one argument, by the name that a request and a command have for each."""

ORDER_NAMES = (*(name for name in WITH_WHAT if name != "traceback"), "priority", "release")
"""The names of all orders; the other requests are questions."""

_CALLED: Mapping[type, str] = {kind: name for name, kind in WITH_WHAT.items()}
_BARE: Mapping[type, str] = {AskStatus: "status", ReleaseTarget: "release", Follow: "follow"}


@dataclass(frozen=True, slots=True)
class Answer:
    """The reply to an order, as it is sent to the caller."""

    done: bool
    sentence: str
    status: Mapping[str, Any] | None = None
    is_unusable: bool = False  # the order cannot be read, or names what the spec does not have


def order_line(order: Spoken | Follow) -> bytes:
    """Encode a request."""
    match order:
        case AskStatus() | ReleaseTarget() | Follow():
            return _line({"v": VERSION, "do": _BARE[type(order)]})
        case SetPriority(function, priority):
            return _line({"v": VERSION, "do": "priority", "what": function, "to": priority})
        case Reload(file, digest, for_standby):
            do = "ready" if for_standby else "reload"
            return _line({"v": VERSION, "do": do, "what": file, "digest": digest})
        case EnterPhase(what) | FlyScript(what):
            return _line({"v": VERSION, "do": _CALLED[type(order)], "what": what})
        case _:
            return _line({"v": VERSION, "do": _CALLED[type(order)], "what": order.element})


def read_order(line: bytes) -> Spoken | Follow | str:
    """Decode a request; gives a sentence that says what is wrong if the line is no request."""
    match _fields(line):
        case {"v": int(version)} if version != VERSION:
            return f"this manager uses version {VERSION} of the control protocol, not {version}: use the same heronry"
        case {"v": _, "do": "status"}:
            return AskStatus()
        case {"v": _, "do": "priority", "what": str(what), "to": int() | None as priority}:
            return SetPriority(what, priority)
        case {"v": _, "do": "reload" | "ready" as do, "what": str(what), "digest": str(digest)}:
            return Reload(what, digest, for_standby=do == "ready")
        case {"v": _, "do": "release"}:
            return ReleaseTarget()
        case {"v": _, "do": "follow"}:
            return Follow()
        case {"v": _, "do": str(do), "what": str(what)} if do in WITH_WHAT:
            return WITH_WHAT[do](what)
        case _:
            return 'this is no order; write for example {"v": 1, "do": "status"}'


def answer_line(answer: Answer) -> bytes:
    """Encode a reply."""
    more: dict[str, Any] = {} if answer.status is None else {"status": answer.status}
    if answer.is_unusable:
        more["unusable"] = True
    return _line({"v": VERSION, "done": answer.done, "sentence": answer.sentence, **more})


def read_answer(line: bytes) -> Answer | None:
    """Decode a reply; None: the line is no reply.

    Characters that would control a terminal are escaped, since the reply may come from any process.
    """
    match _fields(line):
        case {"v": 1, "done": bool(done), "sentence": str(sentence), **rest}:
            status = rest.get("status")
            is_unusable = rest.get("unusable") is True
            harmless = _harmless(status) if isinstance(status, dict) else None
            return Answer(done, _harmless(sentence), harmless, is_unusable)
        case _:
            return None


def _harmless(value: Any) -> Any:
    """Escape the control characters in all texts of a value; line breaks and tabs stay."""
    match value:
        case str():
            if value.isprintable():
                return value
            return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in value)
        case dict():
            return {_harmless(key): _harmless(one) for key, one in value.items()}
        case list():
            return [_harmless(one) for one in value]
        case _:
            return value


def _line(fields: Mapping[str, object]) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def _fields(line: bytes) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None
