"""The actions of a demo, as its options give them.

    --kill pe:NAME@SECONDS          or manager@SECONDS
    --restore pe:NAME@SECONDS
    --phase NAME@SECONDS

SECONDS count from the moment at which the first configuration runs.
"""

import re
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from heronry_dg.model import Spec
from heronry_dg.plan_document import PlanDocument
from heronry_dg.situation import UnknownElementError, checked_element, checked_phase
from heronry_tools.console.errors import UserError

MANAGER = "manager"
_PATTERN = re.compile(r"(?P<element>pe:[^@]+|manager)@(?P<seconds>\d{1,6}(\.\d{1,9})?)", re.ASCII)
_PHASE_PATTERN = re.compile(r"(?P<phase>[^@]+)@(?P<seconds>\d{1,6}(\.\d{1,9})?)", re.ASCII)


@dataclass(frozen=True, slots=True, order=True)
class DemoAction:
    """An action of --kill or --restore, and the time at which it is done.

    at_s: in s, from the moment at which the first configuration runs.
    pe: the name of a PE; for "kill" also MANAGER, the active manager.
    """

    at_s: float
    what: Literal["kill", "restore"]
    pe: str


@dataclass(frozen=True, slots=True, order=True)
class PhaseAction:
    """The operator's order to enter the mission phase `phase` at the time `at_s`."""

    at_s: float
    phase: str


def read_phases(spec: Spec, texts: list[str]) -> list[PhaseAction]:
    """Read the values of the option `--phase`, and give them in order of time.

    Raises UserError if a value cannot be read, or names a phase that the spec does not have.
    """
    return sorted(_phase_action(spec, text) for text in texts)


def read_script(spec: Spec, kills: list[str], restores: list[str]) -> list[DemoAction]:
    """Read kills and restores, in order of time; raises UserError for one that cannot be read or carried out."""
    actions = [_action(spec, "kill", text) for text in kills] + [_action(spec, "restore", text) for text in restores]
    running = {*spec.pes, MANAGER}
    for action in sorted(actions):
        if (action.what == "kill") != (action.pe in running):
            if action.pe == MANAGER:
                remedy = "only one --kill can name the manager; leave this one out"
                raise UserError(f"--kill {MANAGER}@{action.at_s:g}: {remedy}")
            state = "runs" if action.pe in running else "does not run"
            raise UserError(
                f"--{action.what} pe:{action.pe}@{action.at_s:g}: {action.pe} {state} at that time; "
                "kill and restore in turn"
            )
        running ^= {action.pe}
    return sorted(actions)


def default_actions(plan: PlanDocument | None, seconds: float) -> list[DemoAction]:
    """Return the usual actions: the PE with most modules is killed after 4 s, and restored after 9 s.

    Actions that are not due within the first `seconds` of the demo are left out.
    """
    runs = Counter() if plan is None else Counter(running.pe for running in plan.modules.values())
    if not runs:
        return []
    busiest = max(runs, key=lambda pe: (runs[pe], pe))
    both = DemoAction(4.0, "kill", busiest), DemoAction(9.0, "restore", busiest)
    return [action for action in both if action.at_s < seconds]


def _phase_action(spec: Spec, text: str) -> PhaseAction:
    match = _PHASE_PATTERN.fullmatch(text)
    if match is None:
        raise UserError(f"--phase {text}: write it as NAME@SECONDS, for example --phase landing@4")
    try:
        return PhaseAction(float(match["seconds"]), checked_phase(spec, match["phase"]))
    except UnknownElementError as error:
        raise UserError(f"--phase {text}: {error}") from None


def _action(spec: Spec, what: Literal["kill", "restore"], text: str) -> DemoAction:
    match = _PATTERN.fullmatch(text)
    if match is None:
        or_manager = " or manager@4" if what == "kill" else ""  # a manager is not restored
        example = f"for example pe:{next(iter(spec.pes))}@4{or_manager}"
        raise UserError(f"--{what} {text}: write it as pe:NAME@SECONDS, {example}")
    if match["element"] == MANAGER and what == "restore":
        raise UserError(f"--restore {text}: --restore starts only PEs again, no manager; leave this option out")
    if match["element"] == MANAGER:
        return DemoAction(float(match["seconds"]), what, MANAGER)
    try:
        element = checked_element(spec, match["element"])
    except UnknownElementError as error:
        raise UserError(f"--{what} {text}: {error}") from None
    return DemoAction(float(match["seconds"]), what, element.removeprefix("pe:"))
