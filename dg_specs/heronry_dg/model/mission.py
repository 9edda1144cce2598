"""What the mission asks: phases, the rules by which they begin, the faults to plan ahead for, and common causes."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Final

from heronry_dg.field_types import Names, Part, Span, Threshold
from heronry_dg.keys import Bounds, Key

THRESHOLDS: Final = ("above", "below")
"""The keys of a `When` of which each rule has exactly one."""


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

    def thresholds(self) -> dict[str, Fraction]:
        """Return the thresholds that the rule has, by key; in a spec that is legal, one."""
        given = {name: getattr(self, name) for name in THRESHOLDS}
        return {name: limit for name, limit in given.items() if limit is not None}

    def holds(self, value: Fraction | float) -> bool:
        """Tell whether the rule's condition holds at a value of its variable; so does the agent (`phase_requests`)."""
        return (self.above is not None and value > self.above) or (self.below is not None and value < self.below)


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
