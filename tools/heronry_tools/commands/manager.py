"""`heronry manager`: the system manager of one spec, on one bus."""

import argparse

from heronry_tools.runtime.manager_process import mastership


def run(arguments: argparse.Namespace) -> int:
    """Run the manager; returns 0 if it was stopped, and 1 if it ended by itself."""
    return mastership(arguments)
