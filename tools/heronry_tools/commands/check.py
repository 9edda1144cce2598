"""`heronry check`: checks specs as a linter checks code, for editors, hooks and CI.

Exit codes; with --strict a warning is an error:

    0   no errors, perhaps warnings
    1   errors
    2   the input cannot be used: for example, a file does not exist
    3   a defect of heronry
"""

import argparse
import gc
import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Final

from heronry_dg.check import text_report
from heronry_dg.check.assess import Assessed, Check, Choice, assess, lines_at
from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_dg.loader import SUFFIX, read_file
from heronry_dg.rules.rule import Severity
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_dg.yaml_source import MOST_BYTES
from heronry_pcs.file_rules import RULES as GRAPH_RULES
from heronry_pcs.graph_files import SUFFIXES, findings_in
from heronry_tools.analysis.check.registry import FAMILIES, RULES, checks_of
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_argument import FLOWN
from heronry_wire.command_parser import program_version
from heronry_wire.errors import HeronryError

_STDIN: Final = "<stdin>"


def run(arguments: argparse.Namespace) -> int:
    """Check all files and report; returns the exit code."""
    with _a_short_life() if arguments.fast else nullcontext():
        return _run(arguments)


@contextmanager
def _a_short_life() -> Iterator[None]:
    """Switch Python's garbage collector off in the block; it would take a sixth of the time of a fast check."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _run(arguments: argparse.Namespace) -> int:
    choice = _choice(arguments)
    try:
        with Progress() as progress:
            assessed = [
                _assessed(name, path, choice, progress, fast=arguments.fast) for name, path in _files(arguments.paths)
            ]
        with _defects_of("the report"):
            report = _report(_told(assessed, quiet=arguments.quiet), assessed, arguments)
    except _DefectError as defect:
        print(f"heronry: {defect}", file=sys.stderr)
        return 3
    _write(report)
    return int(any(finding.severity is Severity.ERROR for one in assessed for finding in one.findings))


class _DefectError(Exception):
    """A defect of heronry that stopped a check; its message is one sentence."""


def _choice(arguments: argparse.Namespace) -> Choice:
    for option in ("select", "ignore", "error"):
        for code in getattr(arguments, option):
            if not any(known.startswith(code) for known in RULES):
                raise UserError(f"--{option}: no code begins with '{code}'; 'heronry rules' lists all codes")
    raised = ["DG"] if arguments.strict else arguments.error
    warnings = (code for code, rule in RULES.items() if rule.severity is Severity.WARNING)
    return Choice(
        tuple(arguments.select),
        tuple(arguments.ignore),
        frozenset(code for code in warnings if code.startswith(tuple(raised))),
    )


def _files(paths: Sequence[str]) -> Iterator[tuple[str, Path | None]]:
    """Return the name and path of each file to check, each file once; the path of standard input is None."""
    found: dict[str, Path | None] = {}
    for text in paths:
        path = Path(text)
        if text == "-":
            found[_STDIN] = None
        elif path.is_dir():
            found.update((str(file), file) for file in _specs_below(path))
        else:
            file = _shipped(text) or path
            _expect_readable(file)
            found[str(file)] = file
    return iter(found.items())


def _expect_readable(file: Path) -> None:
    """Raise UserError if a file that the user has named does not exist, or may not be read.

    A file that was found in a folder, and may not be read, gets a finding (DG001) instead.
    """
    if not os.access(file, os.R_OK):
        if file.exists():
            raise UserError(f"{file}: you may not read this file; make it readable for you, or name another one")
        raise UserError(
            f"{file}: there is no such file, folder or shipped spec; "
            f"name a *.dg.yaml, a folder, or one of {', '.join(shipped_spec_names())}"
        )


def _specs_below(folder: Path) -> list[Path]:
    found = []
    for where, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [Path(where, name) for name in sorted(files) if name.endswith((SUFFIX, *SUFFIXES))]
    if not found:
        raise UserError(
            f"{folder}: there is no *{SUFFIX} in this folder or below it, nor a *{SUFFIXES[0]}; "
            "name another folder, or a file"
        )
    return found


def _shipped(text: str) -> Path | None:
    """Return the path of the shipped spec named `text`; None if there is none, or if `text` is the path of a file."""
    is_shipped = text in (*shipped_spec_names(), *FLOWN) and not Path(text).exists()
    return shipped_spec_path(text) if is_shipped else None


def _assessed(name: str, path: Path | None, choice: Choice, progress: Progress, *, fast: bool) -> Assessed:
    findings = Findings(name)
    data = sys.stdin.buffer.read(MOST_BYTES + 1) if path is None else read_file(path, findings)
    if data is None:
        return Assessed(name, tuple(findings))
    with _defects_of(name):
        if name.endswith(SUFFIXES):
            return _graph_file(data, name)
        progress.begin(f"{name}: reading", 0)
        return assess(data, name, _in_stages(name, checks_of(fast=fast), progress), RULES, choice, work=progress)


def _in_stages(name: str, checks: Mapping[str, Check], progress: Progress) -> dict[str, Check]:
    """Return the checks of the families of rules, each of which shows at its beginning which stage it is."""
    titles = {family.prefix: family.title for family in FAMILIES}

    def staged(number: int, prefix: str, check: Check) -> Check:
        def begin(subject: Subject, findings: Findings) -> None:
            progress.begin(f"{name}: stage {number} of {len(checks)}, {titles[prefix]} ({prefix}xx)", 0)
            check(subject, findings)

        return begin

    return {prefix: staged(number, prefix, check) for number, (prefix, check) in enumerate(checks.items(), 1)}


def _graph_file(data: bytes, name: str) -> Assessed:
    """Read a component graph; an error in it is always reported, whichever codes were selected."""
    found = findings_in(data, name)
    return Assessed(name, found, lines_at({finding.place.line for finding in found}, data))


@contextmanager
def _defects_of(what: str) -> Iterator[None]:
    """Turn an unexpected exception of the block into an error with a sentence for the user.

    A HeronryError passes unchanged. A missing package gives a UserError. Any other exception gives a _DefectError, with
    `what` (the file, or "the report") in its sentence.
    """
    try:
        yield
    except HeronryError:
        raise
    except ModuleNotFoundError as missing:
        hint = "install heronry[manager], or use --fast"
        raise UserError(f"the rules that need a solver cannot be checked without {missing.name}: {hint}") from missing
    except Exception as error:
        trace = traceback.extract_tb(error.__traceback__)[-1]
        said = f"heronry itself failed here ({type(error).__name__} at {Path(trace.filename).name}:{trace.lineno})"
        remedy = "this is a defect of heronry: please report it with the checked file"
        raise _DefectError(f"{what}: {said}; {remedy}") from error


def _told(assessed: Sequence[Assessed], *, quiet: bool) -> Sequence[Assessed]:
    """Return the findings to report: all of them, or only the errors if `quiet` is True."""
    return [one.errors_alone() for one in assessed] if quiet else assessed


def _report(told: Sequence[Assessed], assessed: Sequence[Assessed], arguments: argparse.Namespace) -> str:
    form = arguments.format or ("github" if os.environ.get("GITHUB_ACTIONS") else "full")
    match form:
        case "concise":
            return text_report.concise(told)
        case "full":
            colour = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
            by_code = text_report.by_code(told, RULES, colour=colour)
            digests = "" if arguments.quiet else text_report.digests(assessed)
            return f"{by_code}{text_report.full(told, colour=colour)}{digests}{text_report.summary(assessed)}\n"
    return _machine_report(told, form)


def _machine_report(told: Sequence[Assessed], form: str) -> str:
    from heronry_dg.check import machine_reports  # noqa: PLC0415 - XML is slow to import, and people need none

    rules = {**RULES, **GRAPH_RULES}
    match form:
        case "json":
            return machine_reports.json_report(told, rules)
        case "github":
            return machine_reports.github_report(told)
        case "sarif":
            return machine_reports.sarif_report(told, rules, program_version())
        case _:
            return machine_reports.junit_report(told)


def _write(text: str) -> None:
    """Write a report; characters that the terminal's encoding lacks are escaped."""
    sys.stdout.buffer.write(text.encode(sys.stdout.encoding or "utf-8", "backslashreplace"))
    sys.stdout.flush()
