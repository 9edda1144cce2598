r"""A rule: one kind of mistake in a spec, under a code that never changes its meaning.

A code is `DG` and three digits; the first digit names the family. If a rule is removed, its code is never used for
another rule, since comments and scripts name codes.

A rule has the texts that `heronry explain` and docs/rules.md show, and two examples: `bad` is a spec with the mistake,
and `good` is the corrected spec. Both are fragments: their sections replace those of a small correct spec
(check/examples.py). The tests check that `bad` gets this code and no other, and that `good` gets no finding. An example
that cannot be printed is described in parentheses, and the tests build it.

How a rule is added to a family:

1. Define the rule in the family's file, which also says which file checks the family:

    UNUSED_THING = FAMILY.warning(
        "DG299",
        "unused-thing",
        what="A thing is declared, and nothing uses it.",
        why="It is a leftover, or the name of another one is misspelt where it should be used.",
        fix="Remove it, or use it.",
        bad="things:\n  pump: {}\n",
        good="things: {}\n",
    )

   The rule is one of these:

    FAMILY.warning    a warning
    FAMILY.echo       a warning that an error of the same family may cause
    FAMILY.error      an error
    FAMILY.stop       an error with which a spec cannot be loaded

2. Report the mistake in the check that finds it. The sentence describes the case at hand, with names and numbers. The
   hint says what to write:

    findings.add(UNUSED_THING, place, "nothing uses thing 'pump'", "remove it, or name it in 'uses'")

3. Run the tests of the rules: if an example of an older rule breaks the new rule, too, correct that example.
4. Run `heronry rules -o docs/rules.md`.
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
    """One kind of mistake.

    stops: a spec with this mistake cannot be loaded, so the finding cannot be ignored.
    echo: an error of the same family may cause this finding. So the finding is reported only if the family has no
        error.
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
    """Rules whose codes have the same prefix, such as `DG2`; each code is used once.

    fast: `heronry check --fast` also checks these rules, since their check needs no solver and runs no code of modules.
    """

    prefix: str
    title: str
    fast: bool
    rules: dict[str, Rule] = field(default_factory=dict)

    def stop(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add a rule whose findings are errors that stop a spec from being loaded, and so cannot be ignored."""
        return self._add(Rule(code, name, Severity.ERROR, stops=True, **words))

    def error(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add an error that does not stop a spec from being loaded."""
        return self._add(Rule(code, name, Severity.ERROR, **words))

    def warning(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add a rule whose findings are warnings; gives the rule."""
        return self._add(Rule(code, name, Severity.WARNING, **words))

    def echo(self, code: str, name: str, **words: Unpack[Words]) -> Rule:
        """Add a warning about what may be only a consequence of an error of the family.

        The warning is reported only if the family has no error.
        """
        return self._add(Rule(code, name, Severity.WARNING, echo=True, **words))

    def _add(self, rule: Rule) -> Rule:
        if not rule.code.startswith(self.prefix) or len(rule.code) != 5 or rule.code in self.rules:
            raise AssertionError(f"code {rule.code} is used twice, or is not {self.prefix} followed by two characters")
        self.rules[rule.code] = rule
        return rule
