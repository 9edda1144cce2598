"""The PLAN of a command, a file or standard input, and the situation that its options describe."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from heronry_dg.model import Spec
from heronry_dg.plan import PlanError, read_situation
from heronry_dg.situation import Situation, situation
from heronry_tools.console.errors import UserError


def situation_of(spec: Spec, arguments: argparse.Namespace) -> Situation:
    """Return the situation that the user describes by the options of `add_situation`.

    Raises UnknownElementError as `situation` does.
    """
    return situation(spec, arguments.down or (), arguments.limit or (), arguments.phase, arguments.priority or ())


def evaluated_in(spec: Spec, plan: str, arguments: argparse.Namespace) -> Situation:
    """Return the situation in which to evaluate a plan.

    This is the situation that the plan itself states. Each of the options --down, --limit, --phase and
    --priority that the user gives replaces the same part of it.
    """
    said = situation_of(spec, arguments)
    planned = read_situation(plan, spec)
    return Situation(
        down=planned.down if arguments.down is None else said.down,
        limits=planned.limits if arguments.limit is None else said.limits,
        phase=planned.phase if arguments.phase is None else said.phase,
        priorities=planned.priorities if arguments.priority is None else said.priorities,
    )


@contextmanager
def errors_name(file: str | None) -> Iterator[None]:
    """Convert a PlanError to a UserError whose message begins with the file's name ("standard input" for `-`)."""
    try:
        yield
    except PlanError as error:
        raise UserError(f"{_named(file)}: {error}") from error


def read_text(file: str) -> str:
    """Read a file, or standard input for `-`; a byte order mark is left out."""
    try:
        text = sys.stdin.read() if file == "-" else Path(file).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        remedy = "give UTF-8" if file == "-" else "save the file as UTF-8"
        raise UserError(f"{_named(file)}: byte {error.start} is not UTF-8 text; {remedy}") from error
    return text.removeprefix("\ufeff")


def _named(file: str | None) -> str | None:
    return "standard input" if file == "-" else file
