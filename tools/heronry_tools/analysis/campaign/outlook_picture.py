"""The outlook as pictures: how likely the utility falls below each level, and R(t) of the functions."""

from math import ceil, floor, log10
from typing import Final

from heronry_tools.analysis.campaign.chart import Chart
from heronry_tools.analysis.campaign.outlook import Outlook
from heronry_tools.analysis.reliability.curve import as_reliability

_LEAST: Final = 1e-15
_LABEL_HEIGHT: Final = 13.0
_LABELS_WIDTH: Final = 130
_LETTERS: Final = 18  # of a label


def outlook_picture(outlook: Outlook) -> str:
    """Return a figure: the utility on the horizontal axis, and how likely it falls below, from worst to best.

    The vertical axis is logarithmic.
    """
    levels = falls_below(outlook)
    most = max(1, *(utility for utility, _ in levels))
    shown = [chance for _, chance in levels if chance > _LEAST]
    low = floor(log10(min(shown))) if shown else -1
    high = max(low + 1, ceil(log10(max(shown)))) if shown else 0

    def share(chance: float) -> float:
        return (log10(max(chance, 10.0**low)) - low) / (high - low)

    label = f"Probability that the utility falls below a level within {outlook.hours:g} h"
    chart = Chart(label, "utility")
    for power in range(low, high + 1, max(1, (high - low) // 6)):
        chart.grid_line(share(10.0**power), f"1e{power}")
    points, before = list[tuple[float, float]](), 0
    for utility, chance in levels:
        points += [(before / most, share(chance)), (utility / most, share(chance))]
        before = utility
    chart.line(points)
    for quarter in range(5):
        chart.tick(quarter / 4, str(most * quarter // 4))
    return chart.text(f"{label} (upper: more than {outlook.order} elements down count as utility 0)")


def falls_below(outlook: Outlook) -> list[tuple[int, float]]:
    """Return (utility, an upper bound of the probability that it falls below that), the smallest utility first."""
    below, found = outlook.beyond, list[tuple[int, float]]()
    for utility, chance in reversed(outlook.utilities):
        found.append((utility, below))
        below += chance
    return found


def reliability_picture(outlook: Outlook) -> str:
    """Return a figure: time on the horizontal axis, and R(t) of each function, from its lower to its upper bound.

    The line is the lower bound, or the upper one of a function that has no other.
    """
    lines = {
        name: [(t, loss.low if loss.high is None else loss.high) for t, loss in curve]
        for name, curve in outlook.curves.items()
    }
    deepest = max((loss for curve in lines.values() for _, loss in curve), default=0.0) or 1.0
    label = "R(t): probability that the best plan serves a function after t hours"
    chart = Chart(label, "hours", right=_LABELS_WIDTH)
    for quarter in range(5):
        chart.grid_line(quarter / 4, as_reliability(deepest * (4 - quarter) / 4))
        chart.tick(quarter / 4, f"{outlook.hours * quarter / 4:g}")

    def places(curve: list[tuple[float, float]]) -> list[tuple[float, float]]:
        return [(t / outlook.hours, 1.0 - loss / deepest) for t, loss in curve]

    for name, curve in lines.items():
        chart.area(places(curve), places([(t, loss.low) for t, loss in outlook.curves[name]]))
        chart.line(places(curve))
    at = -_LABEL_HEIGHT
    for name in sorted(lines, key=lambda one: lines[one][-1][1]):
        at = max(at + _LABEL_HEIGHT, chart.y(1.0 - lines[name][-1][1] / deepest))
        chart.beside(at, name if len(name) <= _LETTERS else f"{name[: _LETTERS - 1]}\N{HORIZONTAL ELLIPSIS}")
    return chart.text(f"{label}, from the lower to the upper bound, by plans to order {outlook.order}")
