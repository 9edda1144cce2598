r"""A rule: one thing that can be wrong with a spec, under a code that never changes its meaning.

A code is `DG` and three digits; the first digit names the family. A code that is no longer used is retired, and never
given to another rule, since comments and scripts name codes.

A rule carries the text of `heronry explain` and of docs/rules.md, and its own proof: `bad` is a spec with the mistake
and `good` its corrected twin. Both are fragments: their sections replace those of a small sound spec
(check/examples.py), and the tests check that the one gets this code alone and the other none. An example that cannot be
printed is described in parentheses, and the tests make it.

How a rule is added to a family (the family's file says which file checks it):

    UNUSED_THING = FAMILY.warning(
        "DG299",
        "unused-thing",
        what="A thing is declared, and nothing uses it.",
        why="It is a leftover, or the name of another one is misspelt where it should be used.",
        fix="Remove it, or use it.",
        bad="things:\n  pump: {}\n",
        good="things: {}\n",
    )

A family makes a `warning`, an `echo` (a warning that an error may cause), an `error`, or a `stop` (an error with which
a spec cannot be loaded). Where it is seen:

    findings.add(UNUSED_THING, place, "nothing uses thing 'pump'", "remove it, or name it in 'uses'")

The sentence describes this one case, with names and numbers; the hint says what to write. Then tests/dg/twins needs two
whole specs, DG299.bad.yaml and DG299.good.yaml, a line apart; and `heronry rules --docs >docs/rules.md`. The twins of
older rules may break the new rule too: mend them, since each must earn its own code alone.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypedDict, Unpack


class Severity(StrEnum):
    """How bad a finding is; an error makes `heronry check` fail."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that can be wrong.

    `stops`: a spec with it cannot be loaded at all, so it is never ignored. `echo`: an error of its family may cause
    it, so it is reported only where there is none.
    """

    code: str
    name: str
    severity: Severity
    what: str
    why: str
    fix: str
    bad: str
    good: str
    stops: bool = False
    echo: bool = False


class Words(TypedDict):
    """The texts of a rule, and its two examples."""

    what: str
    why: str
    fix: str
    bad: str
    good: str


@dataclass(slots=True)
class Family:
    """Rules whose codes begin alike; `fast` where they need no solver. A code is taken once."""

    prefix: str
    title: str
    fast: bool
    rules: dict[str, Rule] = field(default_factory=dict)

    def stop(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add an error that stops a spec from being loaded at all, and so is never ignored."""
        return self._add(Rule(code, name, Severity.ERROR, stops=True, **words))

    def error(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add an error that is checked in a spec that loads."""
        return self._add(Rule(code, name, Severity.ERROR, **words))

    def warning(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add a warning."""
        return self._add(Rule(code, name, Severity.WARNING, **words))

    def echo(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add a warning that an error of the family may cause."""
        return self._add(Rule(code, name, Severity.WARNING, echo=True, **words))

    def _add(self, rule: Rule) -> Rule:
        if not rule.code.startswith(self.prefix) or len(rule.code) != 5 or rule.code in self.rules:
            raise AssertionError(f"{rule.code} is no new code of family {self.prefix}")
        self.rules[rule.code] = rule
        return rule
