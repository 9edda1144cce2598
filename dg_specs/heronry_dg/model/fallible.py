"""The keys that elements of several kinds have."""

from dataclasses import dataclass
from typing import Annotated

from heronry_dg.field_types import FailureRate, Probability
from heronry_dg.keys import Key


@dataclass(frozen=True, slots=True, kw_only=True)
class Fallible:
    """An element that may have a failure rate, or a probability of failure."""

    rate_per_h: Annotated[
        FailureRate | None, Key("Failures per hour; only analysis uses it.", 0.0005, 1e-5, analysis_only=True)
    ] = None
    probability: Annotated[
        Probability | None,
        Key(
            "Probability of failure, whatever the time, in place of `rate_per_h`; only analysis uses it.",
            0.001,
            analysis_only=True,
        ),
    ] = None
