"""The option --contingencies: with which plans made ahead a system flies (`analysis.made_ahead` makes them)."""

import argparse
from enum import Enum
from pathlib import Path
from typing import Final

SINGLE_FAULTS_KEPT: Final = "the plans for every single fault, made once and kept in the user's cache"


class Ahead(Enum):
    """Which plans are made ahead where the user names no file."""

    SINGLE_FAULTS = "the plans for every single fault"
    NOTHING = "none"


Source = Path | Ahead

CARRIED = "a PE has as many on board as fit; give the manager the same plans"
"""The help text on the plans' purpose, for commands that compile tables."""


def add_contingencies_argument(parser: argparse.ArgumentParser, what: str, default: str = SINGLE_FAULTS_KEPT) -> None:
    """Add the option --contingencies.

    what: the purpose of the plans. default: the plans that are used without the option. Both are for the help text.
    """
    parser.add_argument(
        "--contingencies",
        type=_source,
        default=Ahead.SINGLE_FAULTS,
        metavar="FILE",
        help=f"plans made ahead ({what}): a file of 'heronry contingencies', or 'none' (default: {default})",
    )


def _source(text: str) -> Source:
    return Ahead.NOTHING if text == Ahead.NOTHING.value else Path(text)
