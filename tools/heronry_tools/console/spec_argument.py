"""The SPEC argument of every command: a file, or the name of a shipped spec."""

import argparse
import difflib
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_tools.console.errors import UserError

if TYPE_CHECKING:
    from heronry_dg.model import Function, Spec

SHIPPED = ("big_blue", "elevator_and_chute")


def add_spec_argument(parser: argparse.ArgumentParser, *, default: str | None = None) -> None:
    """Add SPEC; with a default it is optional."""
    parser.add_argument(
        "spec",
        metavar="SPEC",
        nargs="?" if default else None,
        default=default,
        help=f"a *.dg.yaml file, or a shipped spec: {', '.join(SHIPPED)}"
        + (f" (default: {default})" if default else ""),
    )


def load_spec(text: str) -> "Spec":
    """Load what SPEC names; raises UserError or SpecError."""
    from heronry_dg.loader import load  # noqa: PLC0415 - slow to import, and a node has no need of it

    return load(spec_path(text))


def spec_path(text: str) -> Path:
    """File that SPEC names; raises UserError."""
    if Path(text).suffix:
        return Path(text)
    if text in SHIPPED:
        from heronry_dg.shipped import shipped_spec_path  # noqa: PLC0415

        return shipped_spec_path(text)
    if Path(text).exists():
        raise UserError(f"{text}: the name of a spec ends in .dg.yaml; write a path to a *.dg.yaml")
    raise UserError(
        f"'{text}' is neither a file nor a shipped spec ({', '.join(SHIPPED)}); write a path to a *.dg.yaml"
    )


def named_function(spec: "Spec", name: str) -> "Function":
    """Function that an argument names; raises UserError."""
    if name in spec.functions:
        return spec.functions[name]
    close = difflib.get_close_matches(name, spec.functions, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"there is {', '.join(spec.functions)}"
    raise UserError(f"no function is named '{name}'; {hint}")
