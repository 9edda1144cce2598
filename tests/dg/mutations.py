"""Specs with one mistake in them, made from the shipped ones and the examples of the rules.

    python tests/dg/mutations.py 10000 [SEED]

checks so many of them and prints how often the first finding lies in the block that was changed, by kind of mistake,
and which mistakes are reported elsewhere. A block is one element (a PE, a module with its modes ...) or, outside of the
sections, one line. What is lost is looked for where it is missing: an element in its section, a key of the file at the
file's head. A few hundred mutants are part of the tests.
"""

import random
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from heronry_dg import yaml_source
from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.findings import Findings
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.analysis.check.registry import RULES, checks_of

WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
NUMBER = re.compile(r"(?<![\w.@])\d+(?:\.\d+)?(?![\w.])")
KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(?=:)")
VALUE = re.compile(r"(?<=: )[^\s,\[\]{}:]+(?=[,}\s]|$)")
MARK = re.compile(r"[\[\]{},:\"']")
PAIR = re.compile(r"[A-Za-z_]+: [^\s,\[\]{}:]+, ")
ODD_VALUES = (
    "yes",
    "0x1F",
    "-1",
    "1e99",
    "[]",
    "{}",
    "~",
    "true",
    "''",
    "0.00001",
    "999999999999",
    "a b",
    "&x 1",
    "!t x",
)
ODD_CHARACTERS = "[]{}:,#&*!|>'\"%@`-? \tx0é\x07"


@dataclass(frozen=True, slots=True)
class Mutant:
    """A spec with one mistake: how it was made, and the lines of the block that it is in."""

    kind: str
    text: str
    first_line: int
    last_line: int


Change = Callable[[random.Random, str], str | None]  # one line -> that line with a mistake, or nothing to change


def _replaced(pattern: re.Pattern[str], new: Callable[[random.Random, str], str]) -> Change:
    def change(rng: random.Random, line: str) -> str | None:
        found = list(pattern.finditer(line.partition("  #")[0]))
        if not found:
            return None
        match = rng.choice(found)
        return line[: match.start()] + new(rng, match[0]) + line[match.end() :]

    return change


def _misspelt(rng: random.Random, word: str) -> str:
    at = rng.randrange(len(word))
    return rng.choice(
        (word[:at] + word[at + 1 :] or "x", word[:at] + rng.choice("aeiou") + word[at:], word[::-1] + "z")
    )


def _other_number(rng: random.Random, number: str) -> str:
    return rng.choice(
        (f"-{number}", f"{number}00000000000", f"{number}.00005", f"0{number}", f"'{number}'", "0", "1_0")
    )


def _character_added(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line) + 1)
    return line[:at] + rng.choice(ODD_CHARACTERS) + line[at:]


def _character_lost(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line))
    return line[:at] + line[at + 1 :]


def _indented_otherwise(rng: random.Random, line: str) -> str:
    return rng.choice((" " + line, line.removeprefix(" "), "    " + line, "\t" + line))


CHANGES: dict[str, Change] = {
    "a word is misspelt": _replaced(WORD, _misspelt),
    "a key is misspelt": _replaced(KEY, _misspelt),
    "a value is of another kind": _replaced(VALUE, lambda rng, _: rng.choice(ODD_VALUES)),
    "a number is another": _replaced(NUMBER, _other_number),
    "a mark is lost": _replaced(MARK, lambda _, __: ""),
    "a mark is another": _replaced(MARK, lambda rng, _: rng.choice("[]{},:\"'")),
    "a field is lost": _replaced(PAIR, lambda _, __: ""),
    "a field is given twice": _replaced(PAIR, lambda _, pair: pair * 2),
    "a field is made up": _replaced(PAIR, lambda _, pair: pair + "frobnicate: 7, "),
    "a character is added": _character_added,
    "a character is lost": _character_lost,
    "a line is indented otherwise": _indented_otherwise,
    "a line is cut off": lambda rng, line: line[: rng.randrange(1, len(line) + 1)],
    "a line is there twice": lambda _, line: f"{line}\n{line}",
    "a line is lost": lambda _, __: "",
}


def originals() -> list[str]:
    """What is mutated: the shipped specs, and the good examples of all rules (which are short)."""
    shipped = [shipped_spec_path(name).read_text() for name in shipped_spec_names()]
    examples = [whole_spec(rule.good) for rule in RULES.values() if not rule.good.startswith("(")]
    return shipped + [text.decode() for text in dict.fromkeys(examples) if len(text) < 5000]


def mutants(rng: random.Random) -> Iterator[Mutant]:
    """Ever more mutants; every second one of a shipped spec."""
    texts = originals()
    shipped = texts[: len(shipped_spec_names())]
    blocks = {text: _blocks(text) for text in texts}
    while True:
        text = rng.choice(rng.choice((shipped, texts)))
        lines = text.split("\n")
        number = rng.choice(
            [i for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
        )
        kind = rng.choice(list(CHANGES))
        changed = CHANGES[kind](rng, lines[number - 1])
        if changed is None or changed == lines[number - 1]:
            continue
        mutated = "\n".join([*lines[: number - 1], changed, *lines[number:]])
        first, last = blocks[text].lost(number) if not changed.strip() else blocks[text].of(number)
        yield Mutant(kind, mutated, first, last + changed.count("\n"))


@dataclass(frozen=True, slots=True)
class Blocks:
    """Lines at which something begins in a text of so many lines: top-level entries, and elements in them."""

    entries: list[int]
    elements: list[int]
    count: int

    def of(self, line: int) -> tuple[int, int]:
        """First and last line of the block that a line is in."""
        return self._around(line, sorted({*self.entries, *self.elements}))

    def lost(self, line: int) -> tuple[int, int]:
        """The same where the line is gone: what lacks it."""
        first, last = self.of(line)
        if line != first:
            return first, last
        section = self._around(line, self.entries)
        if line != section[0] or section[1] > last:
            return section
        return 1, min((entry for entry in self.entries if entry != line), default=self.count)

    def _around(self, line: int, begins: list[int]) -> tuple[int, int]:
        first = max((begin for begin in begins if begin <= line), default=1)
        return first, min((begin - 1 for begin in begins if begin > line), default=self.count)


def _blocks(text: str) -> Blocks:
    root = yaml_source.read_tree(text.encode(), Findings("x"))
    assert isinstance(root, yaml_source.Mapping)
    sections = [entry.node for entry in root.entries.values() if isinstance(entry.node, yaml_source.Mapping)]
    elements = [inner.place.line for section in sections for inner in section.entries.values()]
    return Blocks([entry.place.line for entry in root.entries.values()], elements, text.count("\n") + 1)


@dataclass(slots=True)
class Tally:
    """The results of the mutants so far."""

    clean: Counter[str] = field(default_factory=Counter)
    inside: Counter[str] = field(default_factory=Counter)
    outside: Counter[tuple[str, str]] = field(default_factory=Counter)

    def assess(self, mutant: Mutant) -> None:
        """Check one more; any exception is a defect, and so is a finding without a hint."""
        found = assess(mutant.text.encode("utf-8", "surrogatepass"), "x.dg.yaml", checks_of(fast=True), RULES).findings
        if not all(finding.hint for finding in found):
            raise AssertionError(f"no hint: {found}")
        if not found:
            self.clean[mutant.kind] += 1
        elif mutant.first_line <= found[0].place.line <= mutant.last_line:
            self.inside[mutant.kind] += 1
        else:
            self.outside[mutant.kind, found[0].code] += 1

    def assessed(self) -> int:
        """Number of mutants so far."""
        return self.clean.total() + self.inside.total() + self.outside.total()

    def share_inside(self) -> float:
        """Of the mutants with findings, those whose first one is in the block that was changed."""
        return self.inside.total() / max(1, self.inside.total() + self.outside.total())

    def table(self) -> str:
        """Write both tables."""
        rows = [f"{'clean':>7} {'in block':>8} {'elsewhere':>9}"]
        for kind in CHANGES:
            elsewhere = sum(times for (one, _), times in self.outside.items() if one == kind)
            rows.append(f"{self.clean[kind]:7} {self.inside[kind]:8} {elsewhere:9}  {kind}")
        rows.append(f"{self.clean.total():7} {self.inside.total():8} {self.outside.total():9}  in all")
        rows += ["", "told elsewhere:"]
        rows += [f"{times:7}  {kind}: {code} {RULES[code].name}" for (kind, code), times in self.outside.most_common()]
        return "\n".join(rows)


def tally(count: int, seed: int) -> Tally:
    """Check so many mutants."""
    result = Tally()
    for _, mutant in zip(range(count), mutants(random.Random(seed)), strict=False):
        result.assess(mutant)
    return result


def main() -> int:
    """Print the result of a run; returns the exit code."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    result = tally(count, seed)
    print(result.table())
    print(f"\n{result.share_inside():.1%} of {result.assessed() - result.clean.total()} with findings in their block")
    return int(result.share_inside() < 0.95)


if __name__ == "__main__":
    sys.exit(main())
