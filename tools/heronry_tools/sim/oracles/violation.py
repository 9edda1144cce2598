"""What an oracle has found."""

from typing import NamedTuple

MISSED = "missed"
"""Rule of a fault that the user has named and that was not injected: no violation by the aircraft."""


class Violation(NamedTuple):
    """Something that must not be, and when it was seen."""

    t_ns: int
    rule: str  # exclusion, clash, digest, epoch, served, active
    story: str
    since_ns: int | None = None  # what is seen at t_ns may have begun at any time since then; None: it began at t_ns

    def __str__(self) -> str:
        return f"{self.t_ns / 1e9:.6f} s  {self.rule}: {self.story}"
