"""The SPEC argument of every command: a file, or the name of a shipped spec (`spec_files` reads it).

A command that reads the spec once also takes `-` (standard input), the <(...) of a shell, and REV:PATH, a file in a
revision of git.
"""

import argparse

SHIPPED = ("big_blue", "elevator_and_chute")
FLOWN = ("eav",)  # shipped for 'heronry fly'; every other command accepts them, too


def add_spec_argument(parser: argparse.ArgumentParser, *, default: str | None = None, optional: bool = False) -> None:
    """Add the argument SPEC; the user may leave it out if there is a default, or if it is optional."""
    parser.add_argument(
        "spec",
        metavar="SPEC",
        nargs="?" if default or optional else None,
        default=default,
        help=f"a *.dg.yaml file, or a shipped spec: {', '.join(SHIPPED)}"
        + (f" (default: {default})" if default else ""),
    )
