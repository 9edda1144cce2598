"""The options that say what a campaign covers: how many faults, of which kinds, in which phases; and who plans."""

import argparse
from typing import Final

KINDS: Final = ("pe", "device", "module", "bus", "channel")


def add_scope_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options --faults, --phase, --kinds, --jobs and --scheduler to a parser."""
    parser.add_argument(
        "--faults",
        metavar="N",
        type=int,
        help="plan for up to N faults at the same time (default: the spec's contingency.faults)",
    )
    parser.add_argument(
        "--phase",
        metavar="NAME",
        action="append",
        help="plan only for this phase; may be repeated (default: the spec's contingency.phases)",
    )
    parser.add_argument(
        "--kinds",
        metavar="KINDS",
        help=f"let only these kinds of elements fail, for example pe,bus (default: {','.join(KINDS)})",
    )
    parser.add_argument("--jobs", metavar="N", type=int, help="how many processes plan (default: one for each CPU)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="plan on this scheduler's Dask cluster, not on this computer"
    )
