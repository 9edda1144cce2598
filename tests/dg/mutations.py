"""Specs with one mistake in them, made from the shipped ones and the examples of the rules.

    python tests/dg/mutations.py 10000 [SEED]

judges so many of them and tells how often the first finding lies in the block that was changed, and which kinds of
mistake are told elsewhere. A block is one element (a PE, a module with its modes ...) or, outside of the sections, one
line. A block that is lost as a whole has no place of its own: what is found about those is counted apart. A few hundred
are part of the tests.
"""

import random
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from heronry_dg import yaml_source
from heronry_dg.check.examples import whole_spec
from heronry_dg.check.judge import judge
from heronry_dg.findings import Findings
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.check.registry import RULES, checks_of

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
    block_is_lost: bool


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
        first, last = blocks[text][number]
        longer = changed.count("\n")
        mutated = "\n".join([*lines[: number - 1], changed, *lines[number:]])
        yield Mutant(kind, mutated, first, last + longer, block_is_lost=number == first and not changed)


def _blocks(text: str) -> dict[int, tuple[int, int]]:
    """First and last line of the block of each line."""
    root = yaml_source.read_tree(text.encode(), Findings("x"))
    assert isinstance(root, yaml_source.Mapping)
    count = text.count("\n") + 1
    begins = {entry.place.line for entry in root.entries.values()}
    for entry in root.entries.values():
        if isinstance(entry.node, yaml_source.Mapping):
            begins |= {inner.place.line for inner in entry.node.entries.values()}
    found, first = {}, 1
    for line in range(1, count + 1):
        first = line if line in begins else first
        last = min((begin - 1 for begin in begins if begin > line), default=count)
        found[line] = (first, last)
    return found


@dataclass(slots=True)
class Tally:
    """What became of the mutants so far."""

    judged: int = 0
    clean: int = 0
    inside: int = 0
    blocks_lost: int = 0
    outside: Counter[tuple[str, str]] = field(default_factory=Counter)

    def judge(self, mutant: Mutant) -> None:
        """Judge one more; whatever it raises is a defect, and so is a finding without a hint."""
        found = judge(mutant.text.encode("utf-8", "surrogatepass"), "x.dg.yaml", checks_of(fast=True), RULES).findings
        if not all(finding.hint for finding in found):
            raise AssertionError(f"no hint: {found}")
        self.judged += 1
        if not found:
            self.clean += 1
        elif mutant.block_is_lost:
            self.blocks_lost += 1
        elif mutant.first_line <= found[0].place.line <= mutant.last_line:
            self.inside += 1
        else:
            self.outside[mutant.kind, found[0].code] += 1

    def share_inside(self) -> float:
        """Of the mutants with findings, those whose first one is in the block that was changed, and still there."""
        return self.inside / max(1, self.judged - self.clean - self.blocks_lost)


def tally(count: int, seed: int) -> Tally:
    """Judge so many mutants."""
    result = Tally()
    for _, mutant in zip(range(count), mutants(random.Random(seed)), strict=False):
        result.judge(mutant)
    return result


def main() -> int:
    """Tell how a run went; returns the exit code."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    result = tally(count, seed)
    print(f"{result.judged} judged, {result.clean} without findings, {result.blocks_lost} of a block that is lost")
    print(f"{result.share_inside():.1%} of the others told in their block; elsewhere:")
    for (kind, code), times in result.outside.most_common(25):
        print(f"{times:6}  {kind}: {code} {RULES[code].name}")
    return int(result.share_inside() < 0.95)


if __name__ == "__main__":
    sys.exit(main())
