"""What a demo does to the system, and when: `--kill pe:NAME@SECONDS`, `--restore pe:NAME@SECONDS`."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element
from heronry_tools.errors import UserError

_PATTERN = re.compile(r"(?P<element>pe:[^@]+)@(?P<seconds>\d{1,6}(\.\d{1,9})?)", re.ASCII)


@dataclass(frozen=True, slots=True, order=True)
class Act:
    """One act: seconds after the start of the show (the first configuration runs), what, and to which PE."""

    at_s: float
    what: Literal["kill", "restore"]
    pe: str


def read_script(spec: Spec, kills: list[str], restores: list[str]) -> list[Act]:
    """Acts in order of time; raises UserError for what cannot be read, does not exist or cannot be done then."""
    acts = [_act(spec, "kill", text) for text in kills] + [_act(spec, "restore", text) for text in restores]
    running = set(spec.pes)
    for act in sorted(acts):
        if (act.what == "kill") != (act.pe in running):
            state = "runs" if act.pe in running else "does not run"
            raise UserError(f"--{act.what} pe:{act.pe}@{act.at_s:g}: {act.pe} {state} then; kill and restore in turn")
        running ^= {act.pe}
    return sorted(acts)


def default_acts(plan: Mapping[str, Any]) -> list[Act]:
    """Acts of a demo that was given none: the PE that runs most modules is killed, and comes back."""
    runs = Counter(module["pe"] for module in plan.get("modules", {}).values())
    if not runs:
        return []
    busiest = max(runs, key=lambda pe: (runs[pe], pe))
    return [Act(4.0, "kill", busiest), Act(9.0, "restore", busiest)]


def _act(spec: Spec, what: Literal["kill", "restore"], text: str) -> Act:
    match = _PATTERN.fullmatch(text)
    if match is None:
        raise UserError(f"--{what} {text}: write it as pe:NAME@SECONDS, for example pe:{next(iter(spec.pes))}@4")
    try:
        element = checked_element(spec, match["element"])
    except UnknownElementError as error:
        raise UserError(f"--{what} {text}: {error}") from None
    return Act(float(match["seconds"]), what, element.removeprefix("pe:"))
