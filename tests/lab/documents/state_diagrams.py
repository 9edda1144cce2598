"""Diagrams, in mermaid, of the state machines that are tables in the code."""

from enum import Enum
from typing import Any

from heronry_manager.core.epochs import STAGE_TRANSITIONS
from heronry_manager.core.mastership import MASTERSHIP_TRANSITIONS
from heronry_manager.core.membership import STANDING_TRANSITIONS
from heronry_manager.core.transitions import TransitionTable


def mastership_of_a_manager() -> str:
    """Draw whether a manager is the active one."""
    return _diagram(MASTERSHIP_TRANSITIONS)


def standing_of_a_pe() -> str:
    """Draw whether a PE is available to a manager."""
    return _diagram(STANDING_TRANSITIONS)


def stage_of_an_epoch() -> str:
    """Draw the stages of an epoch at the manager."""
    return _diagram(STAGE_TRANSITIONS)


def _diagram(table: TransitionTable[Any, Any]) -> str:
    """Draw every change from one state to another once, with all its causes."""
    arrows: dict[tuple[Enum, Enum], list[str]] = {}
    for before, _, after, why in table.rows:
        if before is not after:
            arrows.setdefault((before, after), []).append(why)
    lines = [f"[*] --> {state.name}: {why}" for state, why in table.beginnings.items()]
    lines += [f"{before.name} --> {after.name}: {', or '.join(whys)}" for (before, after), whys in arrows.items()]
    return "\n".join(["```mermaid", "stateDiagram-v2", *(f"    {line}" for line in lines), "```"])
