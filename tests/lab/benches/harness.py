"""The harness of all benchmarks: options, the line about the machine, figures, tables of times, JSON, and errors.

A benchmark is one file: its own options, and a function that measures. The function passes its results to a `Report`,
which prints each line as it comes, or with `--json` one line of JSON at the end: figures by name, and times by row.
With `--keep FILE` that line is appended to a file, and `--against FILE` compares with the last such run in it (`kept`).

Exit code 0; 1 where a requirement of the benchmark is not met; 2 where the input cannot be used.
"""

import argparse
import json
import os
import platform
import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from heronry_tools.console.errors import exit_code
from heronry_tools.console.progress import Progress
from lab.benches import kept

Figure = int | float | str
Item = TypeVar("Item")
Option = Callable[[argparse.ArgumentParser], object]


class Report:
    """Prints the results of a benchmark, as text or as JSON."""

    def __init__(self, bench: str, words: Sequence[str] = (), *, as_json: bool) -> None:
        """Print a line about the machine; `words`: the options of this run."""
        self.is_as_required = True
        self._as_json, self._unit = as_json, ""
        self._document: dict[str, Any] = {
            "bench": bench,
            "machine": platform.machine(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
            "commit": kept.commit(),
            "words": kept.measured_words(words),
        }
        self._sections: list[dict[str, Any]] = []
        self._say("{bench}: {machine}, {cores} cores, Python {python}".format_map(self._document))

    def begin(self, section: str) -> None:
        """Begin a section, in which figures and times may have the names of those in another section."""
        self._sections.append({"section": section, "figures": {}, "times": {}})
        self._unit = ""
        self._say(section)

    def figures(self, sentence: str, **figures: Figure) -> None:
        """Report figures: a sentence with the figures' names in braces, as of `str.format`."""
        self._section()["figures"].update(figures)
        self._say(sentence.format(**figures))

    def times(self, what: str, values: Iterable[float], *, unit: str = "ms", limit: float | None = None) -> None:
        """Report a row of the table: median, p99, p99.9 and the longest; a p99 above the limit fails the benchmark."""
        ordered = sorted(values)
        if not ordered:
            return
        p99, p99_9 = (ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in (0.99, 0.999))
        found = {"median": statistics.median(ordered), "p99": p99, "p99.9": p99_9, "longest": ordered[-1]}
        self.require(limit is None or p99 <= limit)
        told = {"unit": unit, "count": len(ordered), **found} | ({} if limit is None else {"limit": limit})
        self._section()["times"][what] = told
        if self._unit != unit:
            self._say(f"{unit:<34}{'count':>7}{''.join(f'{name:>10}' for name in found)}{'limit':>9}")
            self._unit = unit
        row = f"{what:<34}{len(ordered):>7}{''.join(f'{value:>10.3f}' for value in found.values())}"
        self._say(row + (f"{limit:>9.1f}" if limit is not None else ""))

    def lines(self, lines: Iterable[str]) -> None:
        """Report details as text; the JSON has none of them."""
        for line in lines:
            self._say(line)

    def require(self, holds: bool) -> None:
        """Make the exit code 1 unless the requirement holds."""
        self.is_as_required = self.is_as_required and holds

    def end(self) -> int:
        """Print the JSON, if it is wanted; gives the exit code."""
        if self._as_json:
            print(json.dumps(self.document()), flush=True)
        return 0 if self.is_as_required else 1

    def document(self) -> dict[str, Any]:
        """Return everything that was reported, as `--json` prints it."""
        return {**self._document, "sections": self._sections, "as_required": self.is_as_required}

    def _section(self) -> dict[str, Any]:
        if not self._sections:
            self._sections.append({"section": "", "figures": {}, "times": {}})
        return self._sections[-1]

    def _say(self, line: str) -> None:
        if not self._as_json:
            print(line, flush=True)


class Benchmark:
    """A benchmark as a program: `python -m lab.benches.NAME`."""

    def __init__(
        self, name: str, about: str | None, measure: Callable[[argparse.Namespace, Report], None], *options: Option
    ) -> None:
        """about: the text of its help; measure: gets the options, and in `words` the whole command line."""
        self._name, self._about, self._measure, self._options = name, about, measure, options

    def __call__(self, argv: Sequence[str] | None = None) -> int:
        """Run the benchmark; gives the exit code."""
        return exit_code(lambda: self._run(list(sys.argv[1:] if argv is None else argv)), self._name)

    def _run(self, words: list[str]) -> int:
        parser = argparse.ArgumentParser(
            prog=f"python -m lab.benches.{self._name}",
            description=self._about,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for add in self._options:
            add(parser)
        parser.add_argument("--json", action="store_true", help="one line of JSON instead of text")
        parser.add_argument("--keep", type=Path, metavar="FILE", help="append the figures to FILE, as a line of JSON")
        parser.add_argument(
            "--against", type=Path, metavar="FILE", help="compare with the last run like this one in FILE"
        )
        arguments = parser.parse_args(words)
        arguments.words = words
        report = Report(self._name, words, as_json=arguments.json)
        before = None if arguments.against is None else kept.last_like(arguments.against, report.document())
        self._measure(arguments, report)
        if before is not None:
            report.lines(kept.comparison(before, report.document()))
        if arguments.keep is not None:
            kept.keep(arguments.keep, report.document())
        return report.end()


def option(flag: str, default: object, about: str, kind: Callable[[str], object] = int, metavar: str = "N") -> Option:
    """Make an option with a value, by default a number."""
    told = about if default is None else f"{about} (default: %(default)s)"
    return lambda parser: parser.add_argument(flag, type=kind, default=default, metavar=metavar, help=told)


def spec_option(default: str) -> Option:
    """Make the option that names a spec."""
    return option("--spec", default, "what flies", str, "SPEC")


def seconds_option(default: float, about: str) -> Option:
    """Make the option for the length of a measurement."""
    return option("--seconds", default, about, float, "S")


def counted(what: str, total: int, items: Iterable[Item]) -> Iterator[Item]:
    """Yield one item after the other, and show the progress."""
    with Progress() as progress:
        progress.begin(what, total)
        for item in items:
            yield item
            progress.step()
