"""The process that answers the questions of web pages: what would be planned, and why a function is not served.

    python -m heronry_tools.web.desk SPEC DIGEST           started by `questions`, which keeps the standard input of
                                                           this process open; DIGEST is the digest of the spec that
                                                           the pages show

The process has loaded the solver and the spec. Questions come on standard input, answers go to standard output, each as
one line of JSON, in the order of the questions. The plans of this process are never flown. The process ends when its
standard input is closed, even in the middle of a search. Below, each question is shown with its answer; `...` stands
for further keys. The last answer refuses a question:

    {"ask": "plan", "down": ["pe:nav"], "limits": [], "phase": "glide", "priorities": []}
    {"plan": {... as 'heronry plan --json'}, "graph": {... as in a snapshot}}
    {"ask": "script", "script": "Guav.PruneEdges ();", "modules": {... the running modules, as in a plan}, ...}
    {"plan": {... the configuration that the script makes}, "graph": {...}}
    {"ask": "why", "function": "imaging", "down": [], "phase": null}
    {"why": {... as 'heronry why --json'}}
    {"refused": "no PE is named 'nap'; did you mean 'nav'?"}
"""

import json
import os
import sys
from collections.abc import Collection, Mapping
from queue import SimpleQueue
from threading import Thread
from typing import Any, BinaryIO, Final

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import Plan, check_names, configuration_of, make_plan
from heronry_dg.shortfalls import shortfalls_of
from heronry_dg.situation import Situation, checked_function, situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from heronry_manager.planner.explain import explained
from heronry_manager.shell.script_orders import target_in
from heronry_tools.analysis.why.document import document as why_document
from heronry_tools.analysis.why.reasons import explain
from heronry_tools.watch.graph_marks import LiveGraphs
from heronry_tools.web.changes import plain
from heronry_wire.errors import HeronryError

_LISTS: Final = ("down", "limits", "priorities")
_FIELDS: Final[Mapping[str, type[Collection[Any]]]] = {**dict.fromkeys(_LISTS, list), "phase": str}


class Desk:
    """Answers questions about one spec: the best plan, the plan that a script makes, why a function is not served."""

    def __init__(self, spec: Spec) -> None:
        self._spec, self._graphs = spec, LiveGraphs(spec)

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Answer a question; the answer is a refusal if the question is invalid or names something not in the spec."""
        if not all(_is_right(question.get(key), kind) for key, kind in _FIELDS.items()):
            return {"refused": f"a question has a field of a wrong kind; {', '.join(_LISTS)} are lists of texts"}
        try:
            match question:
                case {"ask": "plan"}:
                    return self._plan(question)
                case {"ask": "script", "script": str(text), "modules": dict(modules)}:
                    return self._script(text, modules, question)
                case {"ask": "why", "function": str(function)}:
                    return self._why(function, question)
                case _:
                    return {"refused": "the planner's process does not know this question"}
        except HeronryError as error:
            return {"refused": str(error)}

    def _plan(self, question: Mapping[str, Any]) -> dict[str, Any]:
        return self._told(plan(self._spec, self._situation(question)))

    def _script(self, text: str, modules: dict[str, Any], question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the plan that a script makes from the running configuration.

        Gives a refusal if the script cannot be applied, or if its result is not legal. A manager also compares
        the plan with the best plan, and refuses the script if the plan that the script makes is worse at level 1.
        """
        spec, now = self._spec, self._situation(question)
        running = configuration_of({"modules": modules})
        check_names(spec, running)
        ordered = target_in(text, spec, now, running)
        if ordered.target is None:
            return {"refused": f"the script would be refused: {ordered.problem}"}
        if broken := verify(spec, now, ordered.target):
            return {"refused": f"the script would be refused: {broken[0]}"}
        return self._told(
            make_plan(spec, now, ordered.target, score(spec, now, ordered.target, running), optimal=False)
        )

    def _situation(self, question: Mapping[str, Any]) -> Situation:
        down, limits, priorities = (question.get(key) or () for key in _LISTS)
        return situation(self._spec, down, limits, question.get("phase"), priorities)

    def _told(self, found: Plan) -> dict[str, Any]:
        found = explained(self._spec, found)
        less = {name: list(shortfalls_of(self._spec, found, one)) for name, one in self._spec.functions.items()}
        graph = plain(self._graphs.graph(found.now, found.configuration))
        return {"plan": found.document(), "graph": graph, "shortfalls": less}

    def _why(self, function: str, question: Mapping[str, Any]) -> dict[str, Any]:
        now = situation(self._spec, question.get("down") or (), (), question.get("phase"))
        one = self._spec.functions[checked_function(self._spec, function)]
        return {"why": why_document(self._spec, explain(self._spec, now, one))}


def _is_right(value: object, kind: type[Collection[Any]]) -> bool:
    """Tell whether a field of a question is missing, or a text or a list of texts as `kind` says."""
    return value is None or (isinstance(value, kind) and all(isinstance(one, str) for one in value))


def main() -> None:
    """Answer the questions that come on standard input, until standard input closes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    spec = load(sys.argv[1])
    changed = spec.digest != sys.argv[2]
    lines: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_read_lines, args=(sys.stdin.buffer, lines), daemon=True).start()
    desk = Desk(spec)
    while True:
        question = json.loads(lines.get())
        refused = {"refused": f"{sys.argv[1]} has changed since it was loaded: start 'heronry web' again"}
        answers.write(json.dumps(refused if changed else desk.answer(question)).encode() + b"\n")
        answers.flush()


def _read_lines(source: BinaryIO, lines: "SimpleQueue[bytes]") -> None:
    for line in source:
        lines.put(line)
    os._exit(0)


if __name__ == "__main__":
    main()
