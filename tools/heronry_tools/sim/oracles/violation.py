"""The violation that an oracle records."""

from typing import NamedTuple

MISSED = "missed"
"""Rule name for a fault that the user named and that was not injected; the aircraft has violated nothing."""


class Violation(NamedTuple):
    """One violation of a rule, and when the oracle saw it."""

    t_ns: int
    rule: str  # for example exclusion, clash, digest, served
    story: str
    since_ns: int | None = None  # the earliest moment at which the violation may have begun; None: it began at t_ns

    def __str__(self) -> str:
        return f"{self.t_ns / 1e9:.6f} s  {self.rule}: {self.story}"
