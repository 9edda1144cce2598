"""Reads the numbers that users give to commands: counts, flights, processors.

Each reader raises `argparse.ArgumentTypeError`.
"""

import argparse
import os


def whole_number(text: str) -> int:
    """Read a whole number, 0 or more."""
    try:
        number = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number; write 0 or more") from None
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; write 0 or more")
    return number


def flights(text: str) -> int:
    """Read a number of flights, 1 or more."""
    number = whole_number(text)
    if number == 0:
        raise argparse.ArgumentTypeError("0 flights show nothing; write 1 or more")
    return number


def processors(text: str) -> int:
    """Read a number of processors; 0 stands for all processors of this computer."""
    return whole_number(text) or os.cpu_count() or 1
