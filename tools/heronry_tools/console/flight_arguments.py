"""The options that the commands that simulate many flights share: their seeds, and how these are flown."""

import argparse

from heronry_tools.console.number_arguments import flights, processors, whole_number


def add_seed_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options --seed and --runs to a parser: which seeds are flown."""
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="first seed (default: 0)")
    parser.add_argument(
        "--runs",
        type=flights,
        default=1,
        metavar="N",
        help="number of flights (default: 1); the first has the seed of --seed, each further one the next seed",
    )


def add_jobs_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option --jobs to a parser: how many flights at a time."""
    parser.add_argument(
        "--jobs", type=processors, default=1, metavar="N", help="flights at a time (default: 1; 0: one per processor)"
    )


def add_compiled_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option --compiled to a parser."""
    parser.add_argument(
        "--compiled",
        action="store_true",
        help="run the simulator as machine code, four times as fast; the first run with this option compiles it",
    )
