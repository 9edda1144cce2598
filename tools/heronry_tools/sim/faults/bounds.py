"""How long a flight may last and how bad its buses may be, for an option as for a scenario file.

No user waits for a flight of more than a day. A bus on which more than half of all frames are destroyed carries too
little for any finding.
"""

from decimal import Decimal

LONGEST_S = 86_400
_WORST_SHARE = 0.5


def read_share(text: str) -> float | None:
    """Read the share of frames that are destroyed; None where the text is no share, or more than a bus survives."""
    try:
        share = float(text)
    except ValueError:
        return None
    return share if 0 <= share <= _WORST_SHARE else None


def written_share(share: float) -> str:
    """Write a share in decimals, to the last digit: a flight with another share is another flight."""
    return f"{Decimal(repr(share)):f}"
