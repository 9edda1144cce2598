"""Writes the texts about rules: one rule for a terminal, and all rules as a page of documentation."""

import re
from collections.abc import Iterable, Sequence
from typing import Final

from heronry_dg.rules.rule import Family, Rule

_MOST_LINES: Final = 24

_HEAD: Final = """\
# Rules

All rules of `heronry check`. `heronry rules -o docs/rules.md` writes this page; `heronry explain DG203` shows one
rule. [check.md](check.md) tells how to select, ignore and raise codes.

A finding that **stops** keeps the spec from being loaded by any command, and cannot be ignored. If an example shows
only a part of a file, the rest is a small spec without findings.
"""


def explained(rule: Rule) -> str:
    """Return the text of one rule for a terminal: what it finds, why that matters, an example and its remedy."""
    stops = ", and keeps the spec from being loaded" if rule.stops else ""
    return "\n".join(
        [
            f"{rule.code} {rule.name} ({rule.severity}{stops})",
            "",
            rule.what,
            "",
            f"Why: {rule.why}",
            f"Fix: {rule.fix}",
            "",
            "Bad:",
            _indented(rule.bad),
            "",
            "Good:",
            _indented(rule.good),
            "",
        ]
    )


def table(rules: Iterable[Rule]) -> str:
    """Return a table of rules for a terminal, one line each."""
    return "".join(f"{rule.code}  {rule.severity:7}  {rule.name:24}  {rule.what}\n" for rule in rules)


def page(families: Sequence[Family]) -> str:
    """Return the page of all rules in Markdown."""
    parts = [_HEAD, *(_family_table(family) for family in families)]
    for family in families:
        parts.append(f"## {family.prefix}xx: {family.title}\n")
        parts += [_section(rule) for _, rule in sorted(family.rules.items())]
    return "\n".join(parts)


def _family_table(family: Family) -> str:
    fast = "part of `--fast`" if family.fast else "slow; not part of `--fast`"
    lines = [f"**{family.prefix}xx: {family.title}** ({fast})\n", "| code | name | severity |", "|---|---|---|"]
    for code, rule in sorted(family.rules.items()):
        severity = f"{rule.severity}, stops" if rule.stops else str(rule.severity)
        lines.append(f"| [{code}](#{_anchor(rule)}) | {rule.name} | {severity} |")
    return "\n".join([*lines, ""])


def _section(rule: Rule) -> str:
    return "\n".join(
        [
            f"### {_title(rule)}\n",
            f"{rule.what}\n",
            f"*Why.* {rule.why}\n",
            f"*Fix.* {rule.fix}\n",
            _example("Bad", rule.bad),
            _example("Good", rule.good),
        ]
    )


def _title(rule: Rule) -> str:
    return f"{rule.code} {rule.name}"


def _anchor(rule: Rule) -> str:
    return _title(rule).lower().replace(" ", "-")


def _example(kind: str, text: str) -> str:
    if text.startswith("("):
        return f"{kind}: {text}\n"
    return f"{kind}:\n\n```yaml\n{_shown(text)}\n```\n"


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" for line in _shown(text).split("\n"))


def _shown(text: str) -> str:
    """Return an example as the page shows it: unprintable characters as codes, long lines and long texts cut."""
    visible = re.sub(r"[^\n -~]", lambda found: f"<{ord(found[0]) & 0xFF:02x}>", text.rstrip("\n"))
    lines = [line if len(line) <= 160 else f"{line[:80]} ... {line[-40:]}" for line in visible.split("\n")]
    if len(lines) > _MOST_LINES:
        left_out = f"# ... and {len(lines) - _MOST_LINES} lines more like these ..."
        lines = [*lines[: _MOST_LINES // 2], left_out, *lines[-_MOST_LINES // 2 :]]
    return "\n".join(lines)
