"""The outlook as a picture: how likely the utility falls below each level, on a logarithmic axis.

The classes of lines and areas are those of the page's style sheet.
"""

from html import escape
from math import ceil, floor, log10
from typing import Final

from heronry_tools.analysis.campaign.outlook import Outlook

_WIDTH: Final = 420
_HEIGHT: Final = 250
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 16, 14, 40
_LEAST: Final = 1e-15


def outlook_picture(outlook: Outlook) -> str:
    """Return a figure: the utility on the horizontal axis, and how likely it falls below, from worst to best."""
    levels = falls_below(outlook)
    most = max(1, *(utility for utility, _ in levels))
    shown = [chance for _, chance in levels if chance > _LEAST]
    low = floor(log10(min(shown))) if shown else -1
    high = max(low + 1, ceil(log10(max(shown)))) if shown else 0

    def x(utility: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * utility / most

    def y(chance: float) -> float:
        share = (log10(max(chance, 10.0**low)) - low) / (high - low)
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * share

    points, before = list[str](), 0
    for utility, chance in levels:
        points += [f"{x(before):.1f},{y(chance):.1f}", f"{x(utility):.1f},{y(chance):.1f}"]
        before = utility
    step = max(1, (high - low) // 6)
    label = escape(f"probability that the utility falls below a level within {outlook.hours:g} h")
    size = f'width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
    upper = f"upper: more than {outlook.order} elements down count as utility 0"
    parts = [
        f'<figure><svg role="img" aria-label="{label}" {size}>',
        *(_grid_line(y(10.0**power), f"1e{power}") for power in range(low, high + 1, step)),
        f'<polyline class="mean" points="{" ".join(points)}"/>',
        *(_tick(x(most * quarter / 4), str(most * quarter // 4)) for quarter in range(5)),
        f'<text class="faint" x="{_WIDTH / 2:.0f}" y="{_HEIGHT - 6}" text-anchor="middle">utility</text>',
        f"</svg><figcaption>{label.capitalize()} ({upper})</figcaption></figure>",
    ]
    return "\n".join(parts)


def falls_below(outlook: Outlook) -> list[tuple[int, float]]:
    """Give (utility, an upper bound of the probability that the utility falls below it), the smallest utility first."""
    below, found = outlook.beyond, list[tuple[int, float]]()
    for utility, chance in reversed(outlook.utilities):
        found.append((utility, below))
        below += chance
    return found


def _grid_line(y: float, label: str) -> str:
    return (
        f'<line class="grid" x1="{_LEFT}" y1="{y:.1f}" x2="{_WIDTH - _RIGHT}" y2="{y:.1f}"/>'
        f'<text class="faint" x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{label}</text>'
    )


def _tick(x: float, label: str) -> str:
    return f'<text x="{x:.1f}" y="{_HEIGHT - 24}" text-anchor="middle">{label}</text>'
