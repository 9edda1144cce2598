"""`heronry combine`: makes one spec of the specs of two vehicles.

With -o the sentences about what was decided are printed; otherwise the spec is, which has them in its head.

Exit codes: 0 the spec was written; 2 the specs cannot become one, or cannot be used.
"""

import argparse
import re
import sys
from pathlib import Path

from heronry_dg.field_types import NAME_PATTERN
from heronry_dg.loader import SUFFIX
from heronry_tools.analysis.combine.combining import combine
from heronry_tools.analysis.combine.joining import Choices
from heronry_tools.analysis.combine.writing import MADE_BY
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import SpecText, spec_text
from heronry_tools.console.whole_file import expect_writable, write_whole


def run(arguments: argparse.Namespace) -> int:
    """Combine two specs, and write the result; returns the exit code."""
    if arguments.first == arguments.second == "-":
        raise UserError("only one of FIRST and SECOND can be standard input; name a file for the other")
    for option in ("name", "prefix"):
        _expect_name(option, getattr(arguments, option))
    choices = Choices(
        over=_over(arguments.over),
        prefix=arguments.prefix,
        name=arguments.name,
        manager=arguments.manager,
        renumber=arguments.renumber,
        roams=tuple(arguments.roams),
    )
    file: Path | None = arguments.spec_file
    if file is not None:
        _expect_place(file)
    first, second = spec_text(arguments.first), spec_text(arguments.second)
    with Working(f"combining {arguments.first} with {arguments.second}"):
        made = combine(_given(first), _given(second), choices, str(file or "<stdout>"))
    if file is None:
        sys.stdout.write(made.text)
        return 0
    write_whole(file, made.text.encode())
    print("\n".join(made.told))
    print(f"{file} has no errors and {made.warnings} warnings; 'heronry check {file}' shows them.")
    return 0


def _given(text: SpecText) -> tuple[bytes, str]:
    return text.data, text.name


def _over(text: str) -> tuple[str, str]:
    near, equals, far = text.partition("=")
    if not near or (equals and not far):
        raise UserError(f"--over {text}: write --over radio, or --over radio=link if the second spec names it link")
    return near, far or near


def _expect_name(option: str, name: str | None) -> None:
    if name is not None and re.fullmatch(NAME_PATTERN, name) is None:
        raise UserError(f"--{option} {name}: write a letter, then letters, digits and '_', at most 64 in all")


def _expect_place(file: Path) -> None:
    """Raise UserError if the file has another ending than a spec, cannot be written, or was written by a person."""
    if not file.name.endswith(SUFFIX):
        raise UserError(f"{file}: the name of a spec's file ends in {SUFFIX}; name such a file")
    expect_writable(file)
    if file.exists() and not file.read_bytes().startswith(MADE_BY.encode()):
        raise UserError(f"{file}: this file was not written by 'heronry combine', and stays; name another file")
