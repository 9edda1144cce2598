"""The SPEC argument of every command: a file, or the name of a shipped spec."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_tools.errors import UserError

if TYPE_CHECKING:
    from heronry_dg.model import Spec

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
    from heronry_dg.loader import load  # noqa: PLC0415 - slow to import, and a node does without what it needs

    return load(spec_path(text))


def spec_path(text: str) -> Path:
    """File that SPEC names; raises UserError."""
    if Path(text).suffix:
        return Path(text)
    if text in SHIPPED:
        from heronry_dg.shipped import shipped_spec_path  # noqa: PLC0415

        return shipped_spec_path(text)
    raise UserError(
        f"'{text}' is neither a file nor a shipped spec ({', '.join(SHIPPED)}); write a path to a *.dg.yaml"
    )
