"""Test whether a PE and a manager conform to the protocol: runs all conformance tests, or those named by a word.

    python -m lab.conformance                        all of them
    python -m lab.conformance pe_staging             those of one file
    python -m lab.conformance a_lease_is_as_good     one

Exit code 0 if the nodes conform to the protocol, 1 if not, 2 usage.
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
    parser.add_argument("words", nargs="*", metavar="WORD", help="run the tests whose names contain one of these")
    words = parser.parse_args(argv).words
    chosen = [name for name in CONFORMANCE_TESTS if not words or any(word in name for word in words)]
    if not chosen:
        files = dict.fromkeys(name.partition(".")[0] for name in CONFORMANCE_TESTS)
        parser.error(f"no test has such a name; name one of these files, or a test in it: {', '.join(files)}")
    wrong = {name: story for name in chosen if (story := conforms(name)[0]) is not None}
    for name, story in wrong.items():
        print(f"{name}: {story}")
    print(f"{len(chosen) - len(wrong)} of {len(chosen)} conformance tests passed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "conformance"))
