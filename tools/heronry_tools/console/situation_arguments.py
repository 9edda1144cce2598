"""The options by which a command gets its situation: what is down, what has less capacity, the phase, priorities."""

import argparse


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
