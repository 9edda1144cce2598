"""The options by which a command gets its situation: what is down, what has less capacity, the phase, priorities."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_dg.situation import Situation


def add_situation(parser: argparse.ArgumentParser) -> None:
    """Add --down, --limit, --phase and --priority."""
    add_down(parser)
    parser.add_argument(
        "--limit",
        metavar="ELEMENT=PERCENT",
        action="append",
        help="a PE or bus that has only this percentage of its capacity left, for example pe:nav=50%%; may be repeated",
    )
    add_phase(parser)
    parser.add_argument(
        "--priority",
        metavar="FUNCTION=N",
        action="append",
        help="a priority of a function, 0 to 32767, instead of that in the spec; may be repeated",
    )


def add_down(parser: argparse.ArgumentParser) -> None:
    """Add --down: the elements that are down."""
    parser.add_argument("--down", metavar="ELEMENT", action="append", help="an element that is down; may be repeated")


def add_phase(parser: argparse.ArgumentParser) -> None:
    """Add --phase."""
    parser.add_argument("--phase", metavar="NAME", help="the mission phase (default: the first one of the spec)")


def situation_of(spec: "Spec", arguments: argparse.Namespace) -> "Situation":
    """Give the situation that the user describes by the options of `add_situation`.

    Raises UnknownElementError as `situation` does.
    """
    from heronry_dg.situation import situation  # noqa: PLC0415 - slow to import; `--help` does not need it

    return situation(spec, arguments.down or (), arguments.limit or (), arguments.phase, arguments.priority or ())
