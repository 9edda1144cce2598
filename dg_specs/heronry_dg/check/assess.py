"""Checks the bytes of one spec file, and gives all findings about it.

The loader runs first; the checks of the rule families run only on a spec that loads. A finding that stops a spec from
being loaded is always reported, even if the user has not selected its code, since no other check runs on that spec.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

from heronry_dg import loader
from heronry_dg.check.comments import Ignore, Instructions, lines_of, read_instructions
from heronry_dg.check.subject import UNSEEN, Subject, Work
from heronry_dg.findings import Finding, Findings
from heronry_dg.rules import file as file_rules
from heronry_dg.rules.rule import Rule, Severity

Check = Callable[[Subject, Findings], None]


@dataclass(frozen=True, slots=True)
class Choice:
    """Which findings the user wants: prefixes of codes to select and to ignore, and codes to report as errors."""

    selected: tuple[str, ...] = ("DG",)
    ignored: tuple[str, ...] = ()
    raised: frozenset[str] = frozenset()

    def includes(self, code: str) -> bool:
        """Tell whether the user wants findings of a code."""
        return code.startswith(self.selected) and not code.startswith(self.ignored)

    def includes_some_of(self, prefix: str) -> bool:
        """Tell whether the user may want findings of at least one code that begins with `prefix`."""
        wanted = any(prefix.startswith(one) or one.startswith(prefix) for one in self.selected)
        return wanted and not prefix.startswith(self.ignored)


@dataclass(frozen=True, slots=True)
class Assessed:
    """The findings about one file, errors first, and the text of the lines with a finding.

    digest: that of the spec (`heronry_dg.meaning`); empty where no spec was loaded.
    """

    file: str
    findings: tuple[Finding, ...]
    lines: Mapping[int, str] = field(default_factory=dict)
    digest: str = ""

    def line(self, number: int) -> str:
        """Return the text of a line that has a finding; empty where the file has no such line."""
        return self.lines.get(number, "")

    def errors_alone(self) -> "Assessed":
        """Return a copy without warnings."""
        return replace(self, findings=tuple(one for one in self.findings if one.severity is Severity.ERROR))


def assess(
    data: bytes,
    file: str,
    checks: Mapping[str, Check],
    rules: Mapping[str, Rule],
    choice: Choice = Choice(),
    *,
    work: Work = UNSEEN,
) -> Assessed:
    """Check the content of a file, and return the findings about it.

    checks: the check of each family of rules, by the prefix of the family's codes.
    rules: all rules, by code. A `# dg:` comment that names another code gives a finding.
    choice: the codes to report; a finding that stops the spec from being loaded is always reported.
    work: shows how far long checks are.
    """
    with loader.collector_at_rest():
        return _assess(data, file, checks, rules, choice, work=work)


def _assess(
    data: bytes, file: str, checks: Mapping[str, Check], rules: Mapping[str, Rule], choice: Choice, *, work: Work
) -> Assessed:
    findings = Findings(file)
    loaded = loader.read(data, file, findings)
    said = read_instructions(data, rules, findings)
    ran = {prefix: check for prefix, check in checks.items() if choice.includes_some_of(prefix)}
    if loaded is not None:
        for check in ran.values():
            check(Subject(file, loaded, work), findings)
    told, used = _told(findings, said, rules, choice)
    told = _without_echoes(told, rules)
    if loaded is not None:
        told += _unused(file, said, used, tuple(ran), choice)
    told = [_raised(finding, said, choice) for finding in told]
    in_order = sorted(told, key=lambda finding: (finding.severity is not Severity.ERROR, finding))
    lines = lines_at({finding.place.line for finding in told}, data)
    return Assessed(file, tuple(in_order), lines, "" if loaded is None else loaded.spec.digest)


def lines_at(numbers: set[int], data: bytes) -> dict[int, str]:
    """Return the lines of a file that have one of these numbers; the file is read up to the last of these lines."""
    last = max(numbers, default=0)
    lines = enumerate(islice(lines_of(data), last), 1) if numbers else ()
    return {number: line for number, line in lines if number in numbers}


def _told(
    findings: Findings, said: Instructions, rules: Mapping[str, Rule], choice: Choice
) -> tuple[list[Finding], set[Ignore]]:
    """Return the findings that are reported, and the ignore comments that match any finding, reported or not."""
    told: list[Finding] = []
    used: set[Ignore] = set()
    for finding in findings:
        ignores = set(said.ignores_of(finding))
        used |= ignores
        if rules[finding.code].stops or (choice.includes(finding.code) and not ignores):
            told.append(finding)
    return told, used


def _without_echoes(told: list[Finding], rules: Mapping[str, Rule]) -> list[Finding]:
    """Remove findings of `echo` rules, which may follow from an error of the same family."""
    hushed = {finding.code[:3] for finding in told if finding.severity is Severity.ERROR}
    return [finding for finding in told if not (rules[finding.code].echo and finding.code[:3] in hushed)]


def _unused(file: str, said: Instructions, used: set[Ignore], ran: tuple[str, ...], choice: Choice) -> list[Finding]:
    """Return a finding for each ignore comment that matched no finding; the comments in `used` matched one.

    A comment counts only if the check of its code ran and the user wants findings of this code.

    ran: prefixes of the families whose checks ran.
    """
    rule = file_rules.UNUSED_IGNORE
    unused = Findings(file)
    for ignore in said.ignores:
        if ignore not in used and ignore.code.startswith(ran) and choice.includes(ignore.code):
            sentence = f"there is no {ignore.code} on line {ignore.line} to ignore"
            unused.add(rule, ignore.place, sentence, f"remove {ignore.code} from the comment")
    return list(unused) if choice.includes(rule.code) else []


def _raised(finding: Finding, said: Instructions, choice: Choice) -> Finding:
    if finding.code in said.raised or finding.code in choice.raised:
        return replace(finding, severity=Severity.ERROR)
    return finding
