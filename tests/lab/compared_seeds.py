"""The command line of a comparison of two ways to compute the same: a range of seeds, and what was found in them."""

import argparse
from collections import Counter
from collections.abc import Iterable


def seed_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser that takes the first seed, and the one after the last."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    return parser


def report(compared: Iterable[tuple[int, str | None, Iterable[str]]]) -> int:
    """Print each disagreement, and then how often each word came; returns the exit code, 1 after a disagreement.

    compared: seed, disagreement or None, and words that tell what was compared.
    """
    counts: Counter[str] = Counter()
    for seed, wrong, words in compared:
        counts.update([*words, *(["disagreements"] if wrong else [])])
        if wrong is not None:
            print(f"seed {seed}: {wrong}", flush=True)
    for word, count in counts.most_common():
        print(f"{count:7} {word}")
    return 1 if counts["disagreements"] else 0
