"""The frame of a picture on the page of a campaign: a grid, ticks, labels and a caption, as SVG in a figure.

The classes of lines, areas and texts are those of the page's style sheet. Places are shares of the axes, from 0 to 1.
"""

from collections.abc import Iterable
from html import escape
from typing import Final

_WIDTH: Final = 420
_HEIGHT: Final = 250
_LEFT, _TOP, _BOTTOM = 56, 14, 40
_RIGHT: Final = 16


class Chart:
    """A frame, to which parts of a picture are added; `text` gives the figure."""

    def __init__(self, label: str, horizontal: str, *, right: int = _RIGHT) -> None:
        """Begin a picture.

        label: what it shows, in words, for readers who do not see it. horizontal: name of the horizontal axis.
        right: room on the right of the axes, in pixels.
        """
        self._label, self._right = escape(label), right
        place = f'x="{_WIDTH / 2:.0f}" y="{_HEIGHT - 6}" text-anchor="middle"'
        self._parts = [f'<text class="faint" {place}>{escape(horizontal)}</text>']

    def x(self, share: float) -> float:
        """Return the horizontal place, in pixels, of a share of the horizontal axis."""
        return _LEFT + (_WIDTH - _LEFT - self._right) * share

    def y(self, share: float) -> float:
        """Return the vertical place, in pixels, of a share of the vertical axis, which points up."""
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * share

    def grid_line(self, share: float, label: str) -> None:
        """Draw a horizontal line with a label on its left."""
        y = self.y(share)
        self._parts += [
            f'<line class="grid" x1="{_LEFT}" y1="{y:.1f}" x2="{_WIDTH - self._right}" y2="{y:.1f}"/>',
            f'<text class="faint" x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{escape(label)}</text>',
        ]

    def tick(self, share: float, label: str) -> None:
        """Write a label below the horizontal axis."""
        self._parts.append(
            f'<text x="{self.x(share):.1f}" y="{_HEIGHT - 24}" text-anchor="middle">{escape(label)}</text>'
        )

    def line(self, points: Iterable[tuple[float, float]]) -> None:
        """Draw a line through some points."""
        self._parts.append(f'<polyline class="mean" points="{self._places(points)}"/>')

    def area(self, lower: Iterable[tuple[float, float]], upper: Iterable[tuple[float, float]]) -> None:
        """Fill what is between two lines; both go from left to right."""
        around = [*upper, *reversed([*lower])]
        self._parts.append(f'<polygon class="area" points="{self._places(around)}"/>')

    def dot(self, point: tuple[float, float], tip: str) -> None:
        """Draw a dot; when the pointer is over it, the browser shows `tip`."""
        x, y = self.x(point[0]), self.y(point[1])
        self._parts.append(
            f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="3.5"><title>{escape(tip)}</title></circle>'
        )

    def beside(self, y: float, text: str) -> None:
        """Write a text on the right of the axes, at a height in pixels."""
        self._parts.append(f'<text x="{_WIDTH - self._right + 6}" y="{y + 4:.1f}">{escape(text)}</text>')

    def text(self, caption: str) -> str:
        """Return the figure."""
        size = f'width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
        return "\n".join(
            [
                f'<figure><svg role="img" aria-label="{self._label}" {size}>',
                *self._parts,
                f"</svg><figcaption>{escape(caption)}</figcaption></figure>",
            ]
        )

    def _places(self, points: Iterable[tuple[float, float]]) -> str:
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in points)
