"""`heronry eds`: the electronic data sheet with which CANopen tools read a PE."""

import argparse
import sys

from heronry_wire.eds import eds_text


def run(_arguments: argparse.Namespace) -> int:
    """Write the EDS; returns the exit code."""
    sys.stdout.write(eds_text())
    return 0
