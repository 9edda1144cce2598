"""The keys that elements of several kinds have."""

from dataclasses import dataclass
from typing import Annotated

from heronry_dg.field_types import FailureRate
from heronry_dg.keys import Key


@dataclass(frozen=True, slots=True, kw_only=True)
class Fallible:
    """An element that may have a failure rate."""

    rate_per_h: Annotated[
        FailureRate | None, Key("Failures per hour; only analysis uses it.", 0.0005, 1e-5, analysis_only=True)
    ] = None
