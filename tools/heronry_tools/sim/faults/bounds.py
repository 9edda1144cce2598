"""Limits for options and scenario files: the longest flight, and the largest share of destroyed frames.

A flight of more than a day takes too long to be of use. A bus on which more than half of all frames are destroyed
carries too little for any finding.
"""

from decimal import Decimal

LONGEST_S = 86_400
_WORST_SHARE = 0.5


def read_share(text: str) -> float | None:
    """Read a share of destroyed frames; None where the text is not a share from 0 to the largest one allowed."""
    try:
        share = float(text)
    except ValueError:
        return None
    return share if 0 <= share <= _WORST_SHARE else None


def written_share(share: float) -> str:
    """Write a share in decimals with all its digits, so that the text gives exactly the same flight again."""
    return f"{Decimal(repr(share)):f}"
