"""Drills a PE and a manager: `python -m lab.conformance` plays all drills, or those whose names hold a word.

    python -m lab.conformance                        all of them
    python -m lab.conformance pe_staging             those of one file
    python -m lab.conformance a_lease_is_as_good     one

Exit code 0 when the node has done everything by the book, 1 when not, 2 usage.
"""

import argparse
import sys
from collections.abc import Sequence

from heronry_tools.console.errors import exit_code
from lab.conformance.conformance_tests import CONFORMANCE_TESTS, conforms


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; gives its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.conformance",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("words", nargs="*", metavar="WORD", help="which drills: those whose names hold one of these")
    words = parser.parse_args(argv).words
    chosen = [name for name in CONFORMANCE_TESTS if not words or any(word in name for word in words)]
    if not chosen:
        files = dict.fromkeys(name.partition(".")[0] for name in CONFORMANCE_TESTS)
        parser.error(f"no drill is named so; name one of these files, or a drill in it: {', '.join(files)}")
    wrong = {name: story for name in chosen if (story := conforms(name)[0]) is not None}
    for name, story in wrong.items():
        print(f"{name}: {story}")
    print(f"{len(chosen) - len(wrong)} of {len(chosen)} drills went by the book")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "conformance"))
