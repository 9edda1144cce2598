"""The option --compiled of the commands that simulate many flights."""

import argparse


def add_compiled_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option --compiled to a parser."""
    parser.add_argument(
        "--compiled",
        action="store_true",
        help="run the simulator as machine code, four times as fast; the first run with this option compiles it",
    )
