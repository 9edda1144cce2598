"""What the mission asks: phases, the rules by which they begin, the faults to plan ahead for, and common causes."""

from dataclasses import dataclass
from typing import Annotated

from heronry_dg.field_types import Names, Part, Span, Threshold
from heronry_dg.keys import Bounds, Key


@dataclass(frozen=True, slots=True)
class When:
    """The rule of a phase: when the phase is entered automatically.

    The variable must be above the threshold `above`, or below the threshold `below`, for the time `hold_ms`.
    """

    variable: Annotated[str, Key("Variable that the rule watches.", "altitude")]
    above: Annotated[Threshold, Key("Threshold that the variable must exceed.", 17000, left_out=None)]
    below: Annotated[Threshold, Key("Threshold that the variable must fall below.", 300, left_out=None)]
    hold_ns: Annotated[
        Span, Key("Time in ms for which the condition must hold without a break.", 500, called="hold_ms", left_out=0)
    ]
    origins: Annotated[
        Names,
        Bounds(min_length=1),
        Key(
            "Phases in which the rule applies; if left out, all phases that are listed before this one.",
            ["glide", "landing"],
            called="from",
            resolved=(),
        ),
    ]


@dataclass(frozen=True, slots=True)
class Phase:
    """A mission phase; the first one listed is the initial one."""

    name: str
    when: Annotated[
        When | None,
        Key(
            "Rule by which the phase is entered automatically.",
            {"variable": "altitude", "above": 17000, "hold_ms": 500},
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class CommonCause:
    """Elements that one cause takes down together (the beta factor)."""

    elements: Annotated[
        Names, Bounds(min_length=2), Key("Elements with rates, or with probabilities.", ["pe:tail_a", "pe:tail_b"])
    ]
    beta: Annotated[Part, Key("Share of their failures that takes down all of them.", 0.1)]


@dataclass(frozen=True, slots=True)
class Contingency:
    """How many simultaneous faults, and which phases, the plans made ahead cover."""

    faults: Annotated[int, Bounds(ge=0, le=8), Key("Number of simultaneous faults to plan ahead for.", 2)] = 1
    phases: Annotated[Names | None, Key("Phases to plan for; all phases if left out.", ["landing"])] = None
