r"""A rule: one thing that can be wrong with a spec, under a code that never changes its meaning.

A code is `DG` and three digits; the first digit names the family. A code that is no longer found is retired, and never
given to another rule: people write codes into comments and scripts.

A rule carries all that `heronry explain` tells and docs/rules.md repeats, and its own proof: `bad` is a spec with
the mistake and `good` its corrected twin. Both are fragments: their sections replace those of a small sound spec
(check/examples.py), and the tests check that the one earns this code alone and the other nothing. What cannot be
shown is told in parentheses, and the tests make it.

How a rule is added to a family (the family's file says where it is looked for):

    UNUSED_THING = FAMILY.rule(
        "DG299",
        "unused-thing",
        Severity.WARNING,
        what="A thing is declared, and nobody uses it.",
        why="It is a leftover, or the name of another one is misspelt where it should be used.",
        fix="Remove it, or use it.",
        bad="things:\n  pump: {}\n",
        good="things: {}\n",
    )

and where the mistake is seen:

    findings.add(UNUSED_THING, place, "thing 'pump' is used by nobody", "remove it, or name it in 'uses'")

The sentence tells of this one case, with names and numbers; the hint says what to write. Then run `heronry rules --docs
>docs/rules.md`; a test compares.
"""

from dataclasses import dataclass, field
from enum import StrEnum


class Severity(StrEnum):
    """How bad a finding is; an error makes `heronry check` fail."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that can be wrong; `stops` where a spec with it cannot be loaded at all, and so it is never ignored."""

    code: str
    name: str
    severity: Severity
    what: str
    why: str
    fix: str
    bad: str
    good: str
    stops: bool


@dataclass(slots=True)
class Family:
    """Rules whose codes begin alike; `fast` where they need no solver."""

    prefix: str
    title: str
    fast: bool
    rules: dict[str, Rule] = field(default_factory=dict)

    def rule(
        self,
        code: str,
        name: str,
        severity: Severity,
        *,
        what: str,
        why: str,
        fix: str,
        bad: str,
        good: str,
        stops: bool = False,
    ) -> Rule:
        """Add a rule; refuses a code that is taken or of another family."""
        if not code.startswith(self.prefix) or len(code) != 5 or code in self.rules:
            raise AssertionError(f"{code} is no new code of family {self.prefix}")
        rule = Rule(code, name, severity, what, why, fix, bad, good, stops)
        self.rules[code] = rule
        return rule
