"""What a demo does to the system, and when: `--kill pe:NAME@SECONDS` (or manager), `--restore ...`, `--phase ...`."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element, checked_phase
from heronry_tools.console.errors import UserError

MANAGER = "manager"
_PATTERN = re.compile(r"(?P<element>pe:[^@]+|manager)@(?P<seconds>\d{1,6}(\.\d{1,9})?)", re.ASCII)
_PHASE_PATTERN = re.compile(r"(?P<phase>[^@]+)@(?P<seconds>\d{1,6}(\.\d{1,9})?)", re.ASCII)


@dataclass(frozen=True, slots=True, order=True)
class Act:
    """One act: seconds after the start of the show (the first configuration runs), what, and to which PE or MANAGER."""

    at_s: float
    what: Literal["kill", "restore"]
    pe: str


@dataclass(frozen=True, slots=True, order=True)
class PhaseAct:
    """The operator's word: a mission phase, so many seconds after the start of the show."""

    at_s: float
    phase: str


def read_phases(spec: Spec, texts: list[str]) -> list[PhaseAct]:
    """Phases in order of time; raises UserError for what cannot be read or does not exist."""
    return sorted(_phase_act(spec, text) for text in texts)


def read_script(spec: Spec, kills: list[str], restores: list[str]) -> list[Act]:
    """Acts in order of time; raises UserError for what cannot be read, does not exist or cannot be done then."""
    acts = [_act(spec, "kill", text) for text in kills] + [_act(spec, "restore", text) for text in restores]
    running = {*spec.pes, MANAGER}
    for act in sorted(acts):
        if (act.what == "kill") != (act.pe in running):
            state = "runs" if act.pe in running else "does not run"
            element = act.pe if act.pe == MANAGER else f"pe:{act.pe}"
            raise UserError(f"--{act.what} {element}@{act.at_s:g}: {act.pe} {state} then; kill and restore in turn")
        running ^= {act.pe}
    return sorted(acts)


def default_acts(plan: Mapping[str, Any]) -> list[Act]:
    """Acts of a demo that was given none: the PE that runs most modules is killed, and comes back."""
    runs = Counter(module["pe"] for module in plan.get("modules", {}).values())
    if not runs:
        return []
    busiest = max(runs, key=lambda pe: (runs[pe], pe))
    return [Act(4.0, "kill", busiest), Act(9.0, "restore", busiest)]


def _phase_act(spec: Spec, text: str) -> PhaseAct:
    match = _PHASE_PATTERN.fullmatch(text)
    if match is None:
        raise UserError(f"--phase {text}: write it as NAME@SECONDS, for example --phase landing@4")
    try:
        return PhaseAct(float(match["seconds"]), checked_phase(spec, match["phase"]))
    except UnknownElementError as error:
        raise UserError(f"--phase {text}: {error}") from None


def _act(spec: Spec, what: Literal["kill", "restore"], text: str) -> Act:
    match = _PATTERN.fullmatch(text)
    if match is None:
        example = f"for example pe:{next(iter(spec.pes))}@4 or manager@4"
        raise UserError(f"--{what} {text}: write it as pe:NAME@SECONDS, {example}")
    if match["element"] == MANAGER and what == "restore":
        raise UserError(f"--restore {text}: a manager that was killed stays dead here, and the standby reigns")
    if match["element"] == MANAGER:
        return Act(float(match["seconds"]), what, MANAGER)
    try:
        element = checked_element(spec, match["element"])
    except UnknownElementError as error:
        raise UserError(f"--{what} {text}: {error}") from None
    return Act(float(match["seconds"]), what, element.removeprefix("pe:"))
