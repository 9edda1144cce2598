"""R(t) drawn with characters, for a report as text."""

from collections.abc import Iterator, Sequence
from typing import Final

_ROWS: Final = 5
_COLUMNS: Final = 49


def curve_lines(losses: Sequence[float], hours: float) -> Iterator[str]:
    """Draw R(t) from 0 to `hours`; the vertical axis ends at the last value.

    losses: 1 - R(t) at times in equal steps, the first one at 0.
    """
    deepest = max(losses) or 1.0
    labels = [as_reliability(deepest * row / (_ROWS - 1)) for row in range(_ROWS)]
    width = max(map(len, labels))
    canvas = [[" "] * _COLUMNS for _ in range(_ROWS)]
    for column in range(_COLUMNS):
        loss = losses[round(column * (len(losses) - 1) / (_COLUMNS - 1))]
        canvas[round(loss / deepest * (_ROWS - 1))][column] = "*"
    for label, row in zip(labels, canvas, strict=True):
        yield f"{label:>{width}} |{''.join(row)}".rstrip()
    end = f"{hours:g} h"
    yield f"{'':{width}} +{'-' * _COLUMNS}"
    yield f"{'':{width}}  0{end:>{_COLUMNS - 1}}"


def as_reliability(loss: float) -> str:
    """Write 1 - loss, so that a small loss can be read."""
    return "1" if loss == 0.0 else f"1 - {loss:.2g}" if loss < 0.01 else f"{1.0 - loss:.3g}"
