"""Waivers: the times in which a rule of an oracle is not verified, because a certain kind of fault is present.

A waiver begins when its fault is injected, and ends one settling time after the end of that fault. The settling time is
the longest time for which a critical function may be silent: one patience, and a second for planning, steps and first
values. A waiver covers a violation that was seen during the waiver, or that may have begun during the waiver. If a kind
of fault has consequences that appear much later (`Kind.lasting`), its waiver has no end.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_tools.sim.oracles.violation import Violation

REPORTS = "reports"
"""Name, in waivers, of the rule that a module reports only real faults."""


@dataclass(slots=True)
class Waiver:
    """Rules of oracles that are not verified from `from_ns` to `to_ns`; a `to_ns` of None is the end of the flight."""

    rules: frozenset[str]
    from_ns: int
    to_ns: int | None = None


class Waivers:
    """All waivers of one flight."""

    def __init__(self, settling_ns: int) -> None:
        """Begin without waivers; each waiver will end `settling_ns` after the end of its fault."""
        self._settling_ns = settling_ns
        self._all: list[Waiver] = []

    def begin(self, rules: frozenset[str], now_ns: int) -> Waiver:
        """Return a waiver of these rules that begins now; the code that ends the fault sets the waiver's `to_ns`."""
        waiver = Waiver(rules, now_ns)
        if rules:
            self._all.append(waiver)
        return waiver

    def cover(self, rule: str, t_ns: int, since_ns: int | None = None) -> bool:
        """Tell whether a rule is waived at `t_ns`, or, with `since_ns`, at any moment from there to `t_ns`."""
        first_ns = t_ns if since_ns is None else since_ns
        return any(
            rule in one.rules
            and one.from_ns <= t_ns
            and (one.to_ns is None or first_ns <= one.to_ns + self._settling_ns)
            for one in self._all
        )

    def promised(self, violations: Iterable[Violation]) -> tuple[Violation, ...]:
        """Return the violations that no waiver covers."""
        return tuple(one for one in violations if not self.cover(one.rule, one.t_ns, one.since_ns))

    def unverified_ns(self, end_ns: int) -> dict[str, int]:
        """Return, by rule, for how many ns of the flight the rule was waived; the flight ends at `end_ns`.

        A rule that was never waived is left out.
        """
        rules = frozenset[str]().union(*(one.rules for one in self._all))
        return {rule: self._length_ns(rule, end_ns) for rule in sorted(rules)}

    def _length_ns(self, rule: str, end_ns: int) -> int:
        total_ns = until_ns = 0
        for one in sorted((one for one in self._all if rule in one.rules), key=lambda one: one.from_ns):
            over_ns = end_ns if one.to_ns is None else min(one.to_ns + self._settling_ns, end_ns)
            total_ns += max(over_ns - max(one.from_ns, until_ns), 0)
            until_ns = max(until_ns, over_ns)
        return total_ns
