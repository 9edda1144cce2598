"""DG248 and DG249: rules of the family DG2 (graph.py) about functions that are wanted at once, and their priorities."""

from heronry_dg.rules.graph import FAMILY
from heronry_dg.rules.samples import DISPLAY, DRIVER, RUNS


def _shared_lamp(priority: str) -> str:
    """Write a spec with two functions, each with a driver of its own for one lamp; the second is wanted in the cruise.

    priority: the priority of the first function in the cruise.
    """
    return (
        f"modules:\n{DRIVER}{DISPLAY}  blinker: {{device: lamp, needs: speed, {RUNS}}}\n"
        "phases: {climb: , cruise: }\n"
        f"functions:\n  showing: {{output: display, priority: {{default: 1, cruise: {priority}}}}}\n"
        "  blinking: {output: blinker, priority: {default: 0, cruise: 1}}\n"
    )


def _with_range(priority: str) -> str:
    """Write a spec with a function that has a `priority_range` and this priority."""
    return (
        "functions:\n  showing: {output: display}\n"
        f"  blinking: {{output: display, priority: {priority}, priority_range: [0, 9]}}\n"
    )


TWO_DRIVERS = FAMILY.warning(
    "DG248",
    "two-drivers",
    what="Two functions that are wanted at once need different drivers of one actuator.",
    why="Of the modules on one actuator only one runs, or they would command it in turn. So only one of the two "
    "functions is served.",
    fix="Let one module drive the actuator for both functions, or want one of them at a time, by phases.",
    bad=_shared_lamp("1"),
    good=_shared_lamp("0"),
)
UNUSED_RANGE = FAMILY.warning(
    "DG249",
    "priority-range-unused",
    what="A function has a `priority_range`, and its priority is 0 in every phase.",
    why="A changed priority replaces the spec's only in phases that want the function, so the range has no effect.",
    fix="Give the function a priority above 0 in some phase, or remove the range.",
    bad=_with_range("0"),
    good=_with_range("1"),
)
