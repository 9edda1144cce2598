"""Figures that are kept: one line of JSON per run in a file, with the commit and the machine, and compared later.

A line is the document of `--json` with two keys more: `commit` (of the checkout; it ends with `+` where files differ
from it), and `words` (the options of the run). Runs are compared only with runs of the same benchmark and options; the
text says so where the machine was another one.
"""

import json
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from heronry_tools.console.errors import UserError

Document = Mapping[str, Any]
_MACHINE = ("machine", "cores", "python")
_OUTPUT = {"--json": 0, "--keep": 1, "--against": 1}  # options that change no figure, and how many words follow each


def commit() -> str:
    """Return the commit of this checkout, with a `+` where files differ from it; `unknown` outside of a repository."""
    try:
        return subprocess.run(
            ["git", "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=+"],
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parent,
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def measured_words(words: Sequence[str]) -> list[str]:
    """Return the words of a command line without the options that only say where the figures go."""
    left, rest = [], iter(words)
    for word in rest:
        name, equals, _ = word.partition("=")
        if name not in _OUTPUT:
            left.append(word)
        elif not equals:
            for _ in range(_OUTPUT[name]):
                next(rest, None)
    return left


def keep(file: Path, document: Document) -> None:
    """Append a run to a file; raises UserError where the file cannot be written."""
    try:
        with file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(document) + "\n")
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}; name a file that can be written with --keep") from error


def last_like(file: Path, document: Document) -> Document:
    """Return the last run in a file of the same benchmark with the same options; raises UserError if there is none."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
        runs = [json.loads(line) for line in lines if line.strip()]
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}; name a file that --keep has written") from error
    except ValueError as error:
        raise UserError(f"{file}: a line is not JSON ({error}); name a file that --keep has written") from error
    like = [
        run
        for run in runs
        if isinstance(run, dict) and all(run.get(key) == document[key] for key in ("bench", "words"))
    ]
    if not like:
        words = " ".join(document["words"]) or "no options"
        raise UserError(f"{file} has no run of {document['bench']} with {words}; keep one first with --keep")
    return dict(like[-1])


def comparison(before: Document, now: Document) -> Iterator[str]:
    """Yield the lines of a comparison: each figure and each row of times, before, now, and their ratio."""
    yield f"against {before['commit']} (now {now['commit']}):"
    if any(before.get(key) != now.get(key) for key in _MACHINE):
        yield "  on another machine: " + ", ".join(f"{key} {before.get(key)} and {now.get(key)}" for key in _MACHINE)
    then = dict(_values(before))
    for place, value in _values(now):
        if place in then:
            ratio = f"{value / then[place]:8.3f}" if then[place] else "       -"
            yield f"  {place:<60}{then[place]:>12.3f}{value:>12.3f}{ratio}"


def _values(document: Document) -> Iterator[tuple[str, float]]:
    for section in document["sections"]:
        for name, figure in section["figures"].items():
            if isinstance(figure, int | float):
                yield f"{section['section']}: {name}", figure
        for what, row in section["times"].items():
            for name in ("median", "p99"):
                yield f"{section['section']}: {what}, {name} ({row['unit']})", row[name]
