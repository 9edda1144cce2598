"""The options --of NAME and --socket PATH, by which a command finds a manager."""

import argparse
from pathlib import Path


def add_manager_argument(parser: argparse.ArgumentParser) -> None:
    """Add the options --of and --socket, of which a user gives at most one to say which manager to call."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--of",
        metavar="NAME",
        help="the manager to call: the name of its spec; for a demo, NAME-demo (default: the only manager)",
    )
    which.add_argument(
        "--socket", type=Path, metavar="PATH", help="the manager's socket, if the manager was started with --socket"
    )
