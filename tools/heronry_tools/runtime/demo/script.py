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
class Fault:
    """One injected fault: seconds after the start (the first configuration runs), what, and to which PE or MANAGER."""

    at_s: float
    what: Literal["kill", "restore"]
    pe: str


@dataclass(frozen=True, slots=True, order=True)
class PhaseAction:
    """An order of the operator: a mission phase, at a time in seconds after the start."""

    at_s: float
    phase: str


def read_phases(spec: Spec, texts: list[str]) -> list[PhaseAction]:
    """Phases in order of time; raises UserError for what cannot be read or does not exist."""
    return sorted(_phase_action(spec, text) for text in texts)


def read_script(spec: Spec, kills: list[str], restores: list[str]) -> list[Fault]:
    """Faults in order of time; raises UserError for what cannot be read, does not exist or cannot be done then."""
    faults = [_fault(spec, "kill", text) for text in kills] + [_fault(spec, "restore", text) for text in restores]
    running = {*spec.pes, MANAGER}
    for fault in sorted(faults):
        if (fault.what == "kill") != (fault.pe in running):
            state = "runs" if fault.pe in running else "does not run"
            element = fault.pe if fault.pe == MANAGER else f"pe:{fault.pe}"
            raise UserError(
                f"--{fault.what} {element}@{fault.at_s:g}: {fault.pe} {state} then; kill and restore in turn"
            )
        running ^= {fault.pe}
    return sorted(faults)


def default_actions(plan: Mapping[str, Any]) -> list[Fault]:
    """Faults of a demo without options: the PE that runs most modules is killed, and comes back."""
    runs = Counter(module["pe"] for module in plan.get("modules", {}).values())
    if not runs:
        return []
    busiest = max(runs, key=lambda pe: (runs[pe], pe))
    return [Fault(4.0, "kill", busiest), Fault(9.0, "restore", busiest)]


def _phase_action(spec: Spec, text: str) -> PhaseAction:
    match = _PHASE_PATTERN.fullmatch(text)
    if match is None:
        raise UserError(f"--phase {text}: write it as NAME@SECONDS, for example --phase landing@4")
    try:
        return PhaseAction(float(match["seconds"]), checked_phase(spec, match["phase"]))
    except UnknownElementError as error:
        raise UserError(f"--phase {text}: {error}") from None


def _fault(spec: Spec, what: Literal["kill", "restore"], text: str) -> Fault:
    match = _PATTERN.fullmatch(text)
    if match is None:
        example = f"for example pe:{next(iter(spec.pes))}@4 or manager@4"
        raise UserError(f"--{what} {text}: write it as pe:NAME@SECONDS, {example}")
    if match["element"] == MANAGER and what == "restore":
        raise UserError(f"--restore {text}: the demo does not restart a manager; the standby manager stays active")
    if match["element"] == MANAGER:
        return Fault(float(match["seconds"]), what, MANAGER)
    try:
        element = checked_element(spec, match["element"])
    except UnknownElementError as error:
        raise UserError(f"--{what} {text}: {error}") from None
    return Fault(float(match["seconds"]), what, element.removeprefix("pe:"))
