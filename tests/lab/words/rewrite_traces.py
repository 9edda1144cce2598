"""Golden traces of an earlier commit, rewritten with the sentences of this one: only words have changed, no decision.

`sentences.tsv` has one row for each changed sentence: old, tab, new. `{name}` stands for what is filled in: one word,
or at the end of a row the rest of the line. A row applies to whole lines, and every line goes through all rows from the
first to the last. A row of two file names means that a golden trace was renamed.

    python -m lab.words.rewrite_traces 66bc6f2

prints the traces of this checkout that differ from the rewritten ones; `--write` replaces them. Exit codes: 0 there are
none; 1 there are some.
"""

import argparse
import re
import subprocess
import tarfile
from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

_CHECKOUT = Path(__file__).parents[3]
_SCENARIOS = "tests/scenarios"
_TABLE = Path(__file__).with_name("sentences.tsv")
_SUFFIX = ".scenario.golden"
_FIELD = re.compile(r"\\{(\w+)\\}($)?")


class Sentence(NamedTuple):
    """A sentence as it was, as a pattern for whole lines, and as it is, as a format."""

    old: re.Pattern[str]
    new: str


class Changes(NamedTuple):
    """The table: sentences in its order, and new names of files by old ones."""

    sentences: tuple[Sentence, ...]
    names: dict[str, str]


def read_changes(table: str) -> Changes:
    """Read a table of old and new sentences."""
    rows = [line.split("\t") for line in table.splitlines()]
    sentences = [Sentence(_pattern(old), new) for old, new in rows if not _is_name(old)]
    return Changes(tuple(sentences), {old: new for old, new in rows if _is_name(old)})


def rewritten(line: str, sentences: Iterable[Sentence]) -> str:
    """Give a line of a trace in the new words."""
    for old, new in sentences:
        found = old.fullmatch(line)
        if found is not None:
            line = new.format_map(found.groupdict())
    return line


def rewritten_traces(before: dict[str, str], changes: Changes) -> dict[str, str]:
    """Give golden traces, by file name, in the new words and under the new names."""
    return {
        changes.names.get(name, name): "".join(f"{rewritten(line, changes.sentences)}\n" for line in text.splitlines())
        for name, text in before.items()
    }


def traces_of(commit: str) -> dict[str, str]:
    """Give the golden traces of a commit, by file name."""
    git = ["git", "-C", str(_CHECKOUT), "archive", commit, _SCENARIOS]
    archive = subprocess.run(git, capture_output=True, check=True).stdout
    traces = {}
    with tarfile.open(fileobj=BytesIO(archive)) as files:
        for member in files:
            content = files.extractfile(member) if member.name.endswith(_SUFFIX) else None
            if content is not None:
                traces[Path(member.name).name] = content.read().decode()
    return traces


def _pattern(old: str) -> re.Pattern[str]:
    """Pattern of whole lines that are this sentence."""
    a_word, the_rest = r"\S+", ".+"

    def filled_in(field: re.Match[str]) -> str:
        return f"(?P<{field[1]}>{a_word if field[2] is None else the_rest})"

    return re.compile(_FIELD.sub(filled_in, re.escape(old)))


def _is_name(old: str) -> bool:
    return old.endswith(_SUFFIX)


def main(words: Sequence[str] | None = None) -> int:
    """Compare the golden traces with those of a commit, or write them; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m lab.words.rewrite_traces", description=__doc__.split("\n")[0])
    parser.add_argument("commit", help="commit with the golden traces in the old sentences")
    parser.add_argument("--write", action="store_true", help="write the traces of the commit, rewritten")
    arguments = parser.parse_args(words)
    expected = rewritten_traces(traces_of(arguments.commit), read_changes(_TABLE.read_text(encoding="utf-8")))
    if arguments.write:
        for name, text in expected.items():
            (_CHECKOUT / _SCENARIOS / name).write_text(text, encoding="utf-8")
    now = {file.name: file.read_text(encoding="utf-8") for file in (_CHECKOUT / _SCENARIOS).glob(f"*{_SUFFIX}")}
    different = sorted(name for name in expected.keys() | now.keys() if expected.get(name) != now.get(name))
    print("\n".join(different) if different else f"{len(now)} golden traces are those of {arguments.commit}, rewritten")
    return 1 if different else 0


if __name__ == "__main__":
    raise SystemExit(main())
