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
from typing import TYPE_CHECKING, Any, Final

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import JSON, Forms, add_output
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_argument import FLOWN
from heronry_wire.errors import HeronryError

if TYPE_CHECKING:
    from heronry_dg.check.assess import Assessed, Check, Choice
    from heronry_dg.check.subject import Subject
    from heronry_dg.findings import Findings

_FORMATS: Final[Forms] = {
    "full": (),
    "concise": (),
    "json": JSON,
    "github": (),
    "sarif": (".sarif", *JSON),
    "junit": (".xml",),
}
_STDIN: Final = "<stdin>"

_EPILOG: Final = """\
examples:
  heronry check                                  every *.dg.yaml and *.pcs.yaml below this folder
  heronry check --fast my.dg.yaml                without the rules that need a solver: for editors and hooks
  heronry check specs/ --strict                  warnings fail, too
  heronry check specs/ --quiet                   errors only; warnings are counted
  heronry check --select DG2,DG4 --ignore DG240  two families, without one code
  heronry check --error DG401 my.dg.yaml         this warning counts as an error
  heronry check -o findings.sarif                for a forge that shows SARIF; --format names all forms
  heronry rules                                  all codes; heronry explain DG203 explains one

In a spec:  speed: {type: FLOAT}  # dg: ignore[DG240] read by the ground station
Above it:   # dg: error[DG401]
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry check`."""
    parser = subparsers.add_parser(
        "check",
        description="Check specs against every rule, and read component graphs (*.pcs.yaml, *.pcs.json). "
        "Exit code 0: no errors; 1: errors; 2: wrong usage.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "paths", metavar="PATH", nargs="*", default=["."], help="a spec, a folder of specs, or - for standard input"
    )
    parser.add_argument("--fast", action="store_true", help="check only the rules that need no solver")
    parser.add_argument(
        "--select",
        metavar="CODES",
        type=_codes,
        default=["DG"],
        help="report only findings with these codes or beginnings of codes, for example DG2,DG401",
    )
    parser.add_argument("--ignore", metavar="CODES", type=_codes, default=[], help="leave out these codes")
    parser.add_argument(
        "--error", metavar="CODES", type=_codes, default=[], help="count warnings with these codes as errors"
    )
    parser.add_argument("--strict", action="store_true", help="count all warnings as errors")
    parser.add_argument("-q", "--quiet", action="store_true", help="report errors only, and the number of warnings")
    add_output(parser, "write the findings as JSON", _FORMATS, "github where GITHUB_ACTIONS is set, full elsewhere")
    parser.set_defaults(run=run)


def _codes(text: str) -> list[str]:
    codes = [code.strip() for code in text.split(",")]
    if not all(codes):
        raise argparse.ArgumentTypeError(
            f"{text!r} leaves a code empty: write codes or beginnings of codes, for example DG2,DG401"
        )
    return codes


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
    from heronry_dg.rules.rule import Severity  # noqa: PLC0415 - pydantic is slow to import

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


def _choice(arguments: argparse.Namespace) -> "Choice":
    from heronry_dg.check.assess import Choice  # noqa: PLC0415
    from heronry_dg.rules.rule import Severity  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES  # noqa: PLC0415

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
    """Give the name and path of each file to check, each file once; the path of standard input is None."""
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
        from heronry_dg.shipped import shipped_spec_names  # noqa: PLC0415

        if file.exists():
            raise UserError(f"{file}: you may not read this file; make it readable for you, or name another one")
        raise UserError(
            f"{file}: there is no such file, folder or shipped spec; "
            f"name a *.dg.yaml, a folder, or one of {', '.join(shipped_spec_names())}"
        )


def _specs_below(folder: Path) -> list[Path]:
    from heronry_dg.loader import SUFFIX  # noqa: PLC0415
    from heronry_pcs.graph_files import SUFFIXES  # noqa: PLC0415

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
    """Give the path of the shipped spec named `text`; None if there is none, or if `text` is the path of a file."""
    from heronry_dg.shipped import shipped_spec_names, shipped_spec_path  # noqa: PLC0415

    is_shipped = text in (*shipped_spec_names(), *FLOWN) and not Path(text).exists()
    return shipped_spec_path(text) if is_shipped else None


def _assessed(name: str, path: Path | None, choice: "Choice", progress: Progress, *, fast: bool) -> "Assessed":
    from heronry_dg.check.assess import Assessed, assess  # noqa: PLC0415
    from heronry_dg.findings import Findings  # noqa: PLC0415
    from heronry_dg.loader import read_file  # noqa: PLC0415
    from heronry_dg.yaml_source import MOST_BYTES  # noqa: PLC0415
    from heronry_pcs.graph_files import SUFFIXES  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES, checks_of  # noqa: PLC0415

    findings = Findings(name)
    data = sys.stdin.buffer.read(MOST_BYTES + 1) if path is None else read_file(path, findings)
    if data is None:
        return Assessed(name, tuple(findings))
    with _defects_of(name):
        if name.endswith(SUFFIXES):
            return _graph_file(data, name)
        progress.begin(f"{name}: reading", 0)
        return assess(data, name, _in_stages(name, checks_of(fast=fast), progress), RULES, choice, work=progress)


def _in_stages(name: str, checks: "Mapping[str, Check]", progress: Progress) -> "dict[str, Check]":
    """Give the checks of the families of rules, each of which shows at its beginning which stage of the work it is."""
    from heronry_tools.analysis.check.registry import FAMILIES  # noqa: PLC0415

    titles = {family.prefix: family.title for family in FAMILIES}

    def staged(number: int, prefix: str, check: "Check") -> "Check":
        def begin(subject: "Subject", findings: "Findings") -> None:
            progress.begin(f"{name}: stage {number} of {len(checks)}, {titles[prefix]} ({prefix}xx)", 0)
            check(subject, findings)

        return begin

    return {prefix: staged(number, prefix, check) for number, (prefix, check) in enumerate(checks.items(), 1)}


def _graph_file(data: bytes, name: str) -> "Assessed":
    """Read a component graph; an error in it is always reported, whichever codes were selected."""
    from heronry_dg.check.assess import Assessed, lines_at  # noqa: PLC0415
    from heronry_pcs.graph_files import findings_in  # noqa: PLC0415

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


def _told(assessed: "Sequence[Assessed]", *, quiet: bool) -> "Sequence[Assessed]":
    """Give the findings to report: all of them, or only the errors if `quiet` is True."""
    return [one.errors_alone() for one in assessed] if quiet else assessed


def _report(told: "Sequence[Assessed]", assessed: "Sequence[Assessed]", arguments: argparse.Namespace) -> str:
    from heronry_dg.check import text_report  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES  # noqa: PLC0415

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


def _machine_report(told: "Sequence[Assessed]", form: str) -> str:
    from heronry_dg.check import machine_reports  # noqa: PLC0415 - XML is slow to import
    from heronry_pcs.file_rules import RULES as GRAPH_RULES  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES  # noqa: PLC0415

    rules = {**RULES, **GRAPH_RULES}
    match form:
        case "json":
            return machine_reports.json_report(told, rules)
        case "github":
            return machine_reports.github_report(told)
        case "sarif":
            return machine_reports.sarif_report(told, rules, _version())
        case _:
            return machine_reports.junit_report(told)


def _version() -> str:
    from importlib.metadata import version  # noqa: PLC0415

    return version("heronry")


def _write(text: str) -> None:
    """Write a report; characters that the terminal's encoding lacks are escaped."""
    sys.stdout.buffer.write(text.encode(sys.stdout.encoding or "utf-8", "backslashreplace"))
    sys.stdout.flush()
