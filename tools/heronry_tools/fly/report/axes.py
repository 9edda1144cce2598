"""A panel in SVG: two axes with units, and the curves between them.

People with the common kinds of colour blindness can tell the colours apart (most are those of Okabe and Ito). Lines
have different dashes, too. Sizes are for a picture 1 000 px wide.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar
from xml.sax.saxutils import escape

WIDTH, LEFT, RIGHT = 1000, 76, 16
_MOST_POINTS = 1500  # of one line: more than the pixels show

BLACK, BLUE, ORANGE, GREEN, PURPLE, SKY, GREY = (
    "#1b1f24", "#0072b2", "#d55e00", "#009e73", "#aa4499", "#56b4e9", "#6e7781",
)  # fmt: skip

STYLE = """
body { font: 15px/1.45 "DejaVu Sans", Verdana, sans-serif; color: #1b1f24; background: #fff; max-width: 1000px;
  margin: 24px auto; padding: 0 12px; }
h1 { font-size: 22px; } h2 { font-size: 16px; margin: 28px 0 4px; } p { margin: 6px 0; } svg { display: block; }
.wide { overflow-x: auto; } table { border-collapse: collapse; margin: 8px 0; display: block; overflow-x: auto; }
td, th { padding: 3px 14px 3px 0; text-align: left; }
th { font-weight: 600; border-bottom: 1px solid #d0d7de; } td.n { text-align: right; }
text { font-family: "DejaVu Sans", Verdana, sans-serif; font-size: 12px; fill: #1b1f24; }
.tick { fill: #57606a; } .grid { stroke: #e6e9ec; } .frame { fill: none; stroke: #8c959f; }
.series { fill: none; stroke-width: 1.8; stroke-linejoin: round; } .good { color: #00664b; } .bad { color: #a63f00; }
"""

Value = float | None
_Row = TypeVar("_Row")


@dataclass(frozen=True, slots=True)
class Scale:
    """Maps a range of values to a range of pixels; `least` and `most` must differ."""

    least: float
    most: float
    begin_px: float
    end_px: float

    def px(self, value: float) -> float:
        """Return the position in px at which a value is drawn."""
        share = (value - self.least) / (self.most - self.least)
        return self.begin_px + share * (self.end_px - self.begin_px)

    def ticks(self, count: int) -> list[float]:
        """Return about `count` round values within the range."""
        step = _round_step((self.most - self.least) / count)
        first = math.ceil(self.least / step - 1e-9)
        last = math.floor(self.most / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def span(values: Iterable[Value], *, least: float = 0.0, margin: float = 0.05) -> tuple[float, float]:
    """Return a range that contains all finite values with a margin, and is at least `least` wide.

    margin: on each side, as a share of the width.
    """
    known = [value for value in values if value is not None and math.isfinite(value)]
    low, high = (min(known), max(known)) if known else (0.0, 1.0)
    lacking = max(least - (high - low), 0.0) / 2.0
    low, high = low - lacking, high + lacking
    edge = margin * (high - low) or 1.0
    return low - edge, high + edge


@dataclass(frozen=True, slots=True)
class Panel:
    """A panel in a picture: its two scales, and the names of its axes with their units."""

    across: Scale
    up: Scale
    across_label: str
    up_label: str

    def line(self, xs: Sequence[Value], ys: Sequence[Value], colour: str, dash: str = "") -> str:
        """Draw a line, with a gap where a value is None."""
        style = f' stroke-dasharray="{dash}"' if dash else ""
        return f'<path class="series" stroke="{colour}"{style} d="{self._way(xs, ys)}"/>'

    def band(self, xs: Sequence[Value], low: Sequence[Value], high: Sequence[Value], colour: str) -> str:
        """Fill the area between two lines, where both have values."""
        rows = [(x, a, b) for x, a, b in _thinned(zip(xs, low, high, strict=True)) if None not in (x, a, b)]
        ahead = [f"{self.across.px(x):.1f},{self._held(b):.1f}" for x, _, b in rows if x is not None and b is not None]
        back = [f"{self.across.px(x):.1f},{self._held(a):.1f}" for x, a, _ in rows if x is not None and a is not None]
        return f'<polygon points="{" ".join(ahead + back[::-1])}" fill="{colour}" fill-opacity="0.22"/>'

    def points(self, xs: Sequence[float], ys: Sequence[float], colour: str, shape: str = "circle") -> Iterator[str]:
        """Draw a mark at each point: a circle if `shape` is "circle", else a cross."""
        for x, y in zip(xs, ys, strict=True):
            across, up = self.across.px(x), self._held(y)
            if shape == "circle":
                yield f'<circle cx="{across:.1f}" cy="{up:.1f}" r="3.5" fill="{colour}" fill-opacity="0.7"/>'
            else:
                way = f"M{across - 4:.1f},{up - 4:.1f}l8,8m0,-8l-8,8"
                yield f'<path class="series" stroke="{colour}" d="{way}"/>'

    def box(self, x: tuple[float, float], y: tuple[float, float], fill: str, opacity: float = 1.0) -> str:
        """Fill a rectangle; `x`: the values at its left and right edge; `y`: the values at its lower and upper edge."""
        left, right = sorted(self.across.px(value) for value in x)
        top, bottom = sorted(self._held(value) for value in y)
        size = f'width="{right - left:.1f}" height="{bottom - top:.1f}"'
        return f'<rect x="{left:.1f}" y="{top:.1f}" {size} fill="{fill}" fill-opacity="{opacity}"/>'

    def frame(self, *, names_across: bool = True, ticks_up: int = 5) -> Iterator[str]:
        """Draw the grid, the ticks with their numbers, and the names of the axes.

        names_across: whether the horizontal axis gets numbers and a name
        ticks_up: about how many ticks the vertical axis gets
        """
        left, right = self.across.begin_px, self.across.end_px
        bottom, top = self.up.begin_px, self.up.end_px
        for value in self.across.ticks(10):
            x = self.across.px(value)
            yield f'<path class="grid" d="M{x:.1f},{top}V{bottom}"/>'
            if names_across:
                yield text(x, bottom + 16, number(value), "middle", "tick")
        for value in self.up.ticks(ticks_up):
            y = self.up.px(value)
            yield f'<path class="grid" d="M{left},{y:.1f}H{right}"/>'
            yield text(left - 6, y + 4, number(value), "end", "tick")
        yield f'<rect class="frame" x="{left}" y="{top}" width="{right - left}" height="{bottom - top}"/>'
        if names_across:
            yield text((left + right) / 2, bottom + 34, self.across_label, "middle")
        middle = (top + bottom) / 2
        turn = f'transform="rotate(-90 16 {middle:.1f})"'
        yield f'<text x="16" y="{middle:.1f}" text-anchor="middle" {turn}>{escape(self.up_label)}</text>'

    def _held(self, value: float) -> float:
        return self.up.px(min(max(value, self.up.least), self.up.most))

    def _way(self, xs: Sequence[Value], ys: Sequence[Value]) -> str:
        way, is_joined = list[str](), False
        for x, y in _thinned(zip(xs, ys, strict=True)):
            if x is None or y is None or not math.isfinite(y):
                is_joined = False
                continue
            way.append(f"{'L' if is_joined else 'M'}{self.across.px(x):.1f},{self._held(y):.1f}")
            is_joined = True
        return "".join(way)


def panel(
    across: tuple[float, float], up: tuple[float, float], labels: tuple[str, str], top: float, height: float
) -> Panel:
    """Return a panel as wide as the picture.

    across, up: ranges of values
    labels: names of the horizontal and of the vertical axis
    top, height: in px
    """
    return Panel(Scale(*across, LEFT, WIDTH - RIGHT), Scale(*up, top + height, top), *labels)


def text(x: float, y: float, words: str, anchor: str = "start", kind: str = "") -> str:
    """Write text at the position (x, y) in px.

    anchor: which part of the text is at the position: start, middle or end.
    kind: a class of `STYLE`; empty: none.
    """
    name = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{name}>{escape(words)}</text>'


def legend(entries: Sequence[tuple[str, str, str]], top: float) -> Iterator[str]:
    """Draw a legend as one row whose texts stand at the height `top`, in px.

    entries: (name, colour, dash) of each entry. The dash `band` is drawn as a filled area, `point` and `cross` as
        single points, every other dash as a line.
    """
    x = float(LEFT)
    for name, colour, dash in entries:
        match dash:
            case "band":
                yield f'<rect x="{x}" y="{top - 9}" width="26" height="10" fill="{colour}" fill-opacity="0.3"/>'
            case "point":
                yield f'<circle cx="{x + 13}" cy="{top - 4}" r="4" fill="{colour}"/>'
            case "cross":
                yield f'<path class="series" stroke="{colour}" d="M{x + 9},{top - 8}l8,8m0,-8l-8,8"/>'
            case _:
                style = f' stroke-dasharray="{dash}"' if dash else ""
                yield f'<path class="series" stroke="{colour}"{style} d="M{x},{top - 4}h26"/>'
        yield text(x + 32, top, name)
        x += 32 + 7.6 * len(name) + 22


def picture(height: float, title: str, parts: Iterable[str]) -> str:
    """Return the SVG of a picture that consists of `parts`."""
    size = f'width="{WIDTH}" height="{height:.0f}" viewBox="0 0 {WIDTH} {height:.0f}"'
    return "\n".join([f'<svg {size} role="img"><title>{escape(title)}</title>', *parts, "</svg>"])


def number(value: float) -> str:
    """Write the number at a tick, without an exponent and without a sign before zero."""
    written = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if written in ("-0", "") else written


def _round_step(raw: float) -> float:
    power = 10.0 ** math.floor(math.log10(raw))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)


def _thinned(rows: Iterable[_Row]) -> list[_Row]:
    every = list(rows)
    stride = max(len(every) // _MOST_POINTS, 1)
    return every[::stride]
