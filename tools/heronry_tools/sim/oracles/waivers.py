"""What cannot be promised, and when: while a fault of some kinds is present, and until all has come right again.

A waiver begins when its fault is injected and ends as long after the fault as something critical may be silent: one
patience, and a second for planning, steps and first values. A violation of another moment counts like any other; one
that may have begun at any time since an earlier moment does not count if it may have begun meanwhile.
Where a fault leaves behind what comes to light much later (`lasting`), its waiver has no end.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_tools.sim.oracles.violation import Violation

REPORTS = "reports"
"""The rule, for waivers, that a module reports real faults only."""


@dataclass(slots=True)
class Waiver:
    """Rules that are not verified from one moment to another one; None: to the end."""

    rules: frozenset[str]
    from_ns: int
    to_ns: int | None = None


class Waivers:
    """The waivers of one flight."""

    def __init__(self, settling_ns: int) -> None:
        """`settling_ns`: how long after a fault its consequences may show."""
        self._settling_ns = settling_ns
        self._all: list[Waiver] = []

    def begin(self, rules: frozenset[str], now_ns: int) -> Waiver:
        """Give a waiver that begins now; the code that ends its fault sets its end (`Waiver.to_ns`)."""
        waiver = Waiver(rules, now_ns)
        if rules:
            self._all.append(waiver)
        return waiver

    def cover(self, rule: str, t_ns: int, since_ns: int | None = None) -> bool:
        """Tell whether a rule is not verified at a moment, or at some moment since another one."""
        first_ns = t_ns if since_ns is None else since_ns
        return any(
            rule in one.rules
            and one.from_ns <= t_ns
            and (one.to_ns is None or first_ns <= one.to_ns + self._settling_ns)
            for one in self._all
        )

    def promised(self, violations: Iterable[Violation]) -> tuple[Violation, ...]:
        """Give the violations that no waiver covers."""
        return tuple(one for one in violations if not self.cover(one.rule, one.t_ns, one.since_ns))

    def unverified_ns(self, end_ns: int) -> dict[str, int]:
        """How many ns of the time up to `end_ns` each rule was not verified."""
        rules = frozenset[str]().union(*(one.rules for one in self._all))
        return {rule: self._length_ns(rule, end_ns) for rule in sorted(rules)}

    def _length_ns(self, rule: str, end_ns: int) -> int:
        total_ns = until_ns = 0
        for one in sorted((one for one in self._all if rule in one.rules), key=lambda one: one.from_ns):
            over_ns = end_ns if one.to_ns is None else min(one.to_ns + self._settling_ns, end_ns)
            total_ns += max(over_ns - max(one.from_ns, until_ns), 0)
            until_ns = max(until_ns, over_ns)
        return total_ns
