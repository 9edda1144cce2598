"""Limits for options and scenario files: the longest flight, the largest share of destroyed frames, how long a demo is.

A flight of more than a day takes too long to be of use. A bus on which more than half of all frames are destroyed
carries too few frames for a flight to show anything.
"""

from decimal import Decimal

LONGEST_S = 86_400
DEMO_S = 15.0
LONGEST_DEMO_S = 1_000_000.0  # a demo with a page goes on until it is interrupted
_WORST_SHARE = 0.5


def read_share(text: str) -> float | None:
    """Return the share of destroyed frames that `text` gives; None if it is not a number from 0 to 0.5."""
    try:
        share = float(text)
    except ValueError:
        return None
    return share if 0 <= share <= _WORST_SHARE else None


def written_share(share: float) -> str:
    """Return a share in decimals with all its digits, so that reading the text gives exactly the same share."""
    return f"{Decimal(repr(share)):f}"
