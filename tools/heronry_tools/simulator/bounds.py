"""How bad the buses of a flight may be: what `--loss` takes, a scenario file takes too, and as it is written there.

A bus on which more than half of all frames are destroyed carries nothing that could be judged.
"""

from decimal import Decimal

_WORST_SHARE = 0.5


def read_share(text: str) -> float | None:
    """Read the share of frames that are destroyed; None where it is none, or more than a bus survives."""
    try:
        share = float(text)
    except ValueError:
        return None
    return share if 0 <= share <= _WORST_SHARE else None


def written_share(share: float) -> str:
    """Write a share in decimals, to the last digit: a flight with another one is another flight."""
    return f"{Decimal(repr(share)):f}"
