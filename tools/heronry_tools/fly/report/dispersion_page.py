"""The report of many flights of one aircraft: where and how hard it lands, and which landings are acceptable.

The `height_bias_m` of a result is the constant error of the height that the aircraft measures. If results have
it, the report shows the share of acceptable landings against this error.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from heronry_tools.fly import acceptance
from heronry_tools.fly.acceptance import CAUSES, Cause, Site, Touchdown, causes, interval
from heronry_tools.fly.report.axes import (
    BLUE,
    GREEN,
    LEFT,
    ORANGE,
    RIGHT,
    WIDTH,
    Panel,
    legend,
    panel,
    picture,
    span,
    text,
)
from heronry_tools.fly.report.flight_page import page

_BIN_M = 0.5
_FEWEST = 3  # a bin with fewer flights is not drawn


@dataclass(frozen=True, slots=True)
class Landing:
    """What the report shows of one flight."""

    seed: int
    touchdown: Touchdown | None
    wind_m_per_s: float | None = None
    height_bias_m: float | None = None
    site: Site = "runway"

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Return the criteria that the landing does not meet; empty for an acceptable landing."""
        return causes(self.touchdown, self.site)


def dispersion_page(title: str, landings: Sequence[Landing]) -> str:
    """Return the HTML of the report of many flights."""
    touched = [landing for landing in landings if landing.touchdown is not None]
    parts = [f"<h1>{escape(title)}</h1>", *_share(landings)]
    if touched:
        parts += [
            "<h2>Where the aircraft touches the ground</h2>",
            _scatter(touched),
            "<h2>Sink at the touchdown</h2>",
            _sinks(touched),
        ]
    if any(landing.height_bias_m is not None for landing in landings):
        parts += ["<h2>Error of height against success</h2>", _by_bias(landings)]
    return page(title, parts)


def _share(landings: Sequence[Landing]) -> Iterator[str]:
    good = sum(not landing.causes for landing in landings)
    low, high = interval(good, len(landings))
    share = 100.0 * good / len(landings) if landings else 0.0
    sure = f"95 % interval {100 * low:.1f} to {100 * high:.1f} % (Wilson)"
    yield f"<p>{good} of {len(landings)} landings are acceptable: {share:.1f} %, {sure}.</p>"
    counted = Counter(cause for landing in landings for cause in landing.causes)
    if counted:
        yield "<table><tr><th>cause</th><th>landings</th></tr>"
        yield from (
            f'<tr><td>{cause}</td><td class="n">{counted[cause]}</td></tr>' for cause in CAUSES if counted[cause]
        )
        yield "</table>"


def _split(landings: Sequence[Landing]) -> tuple[list[Touchdown], list[Touchdown]]:
    good = [landing.touchdown for landing in landings if landing.touchdown is not None and not landing.causes]
    bad = [landing.touchdown for landing in landings if landing.touchdown is not None and landing.causes]
    return good, bad


def _kinds() -> Iterator[str]:
    return legend([("acceptable", BLUE, "point"), ("not acceptable", ORANGE, "cross")], 14)


def _scatter(landings: Sequence[Landing]) -> str:
    good, bad = _split(landings)
    xs = [landing.x_m for landing in good + bad]
    ys = [landing.y_m for landing in good + bad]
    if landings[0].site == "field":
        return _around_home(good, bad, xs, ys)
    limits = acceptance.RUNWAY
    labels = ("x from the aim, along the runway (m)", "y from the centre line (m)")
    drawn = panel(span([*xs, *limits.along_m]), span([*ys, limits.offset_m, -limits.offset_m]), labels, 26, 300)
    box = limits.along_m, (-limits.offset_m, limits.offset_m)
    parts = [*_kinds(), drawn.box(*box, "#d9f0e7"), *drawn.frame(), *_points(drawn, good, bad)]
    return picture(372, "touchdown points", parts)


def _around_home(
    good: Sequence[Touchdown], bad: Sequence[Touchdown], norths: Sequence[float], easts: Sequence[float]
) -> str:
    """Draw a map of the touchdown points around home, with the circle in which a landing is acceptable.

    North is up, and both axes have the same scale.

    norths, easts: positions of the touchdown points in m, all of which are on the map.
    """
    radius = acceptance.FIELD.distance_m
    reach = max(1.2 * radius, *(1.05 * abs(value) for value in (*norths, *easts)))
    height = 600.0
    wide = reach * (WIDTH - LEFT - RIGHT) / height
    drawn = panel((-wide, wide), (-reach, reach), ("east of home (m)", "north of home (m)"), 26, height)
    middle, size = (drawn.across.px(0.0), drawn.up.px(0.0)), drawn.across.px(radius) - drawn.across.px(0.0)
    circle = f'<circle cx="{middle[0]:.1f}" cy="{middle[1]:.1f}" r="{size:.1f}" fill="#d9f0e7"/>'
    parts = [*_kinds(), circle, *drawn.frame()]
    parts += drawn.points([landing.y_m for landing in good], [landing.x_m for landing in good], BLUE)
    parts += drawn.points([landing.y_m for landing in bad], [landing.x_m for landing in bad], ORANGE, "cross")
    return picture(height + 72, "touchdown points", parts)


def _points(drawn: Panel, good: Sequence[Touchdown], bad: Sequence[Touchdown]) -> Iterator[str]:
    yield from drawn.points([landing.x_m for landing in good], [landing.y_m for landing in good], BLUE)
    yield from drawn.points([landing.x_m for landing in bad], [landing.y_m for landing in bad], ORANGE, "cross")


def _sinks(landings: Sequence[Landing]) -> str:
    """Draw the cumulative distribution of the sink rate at the touchdown."""
    sinks = sorted(landing.touchdown.sink_m_per_s for landing in landings if landing.touchdown is not None)
    shares = [100.0 * (index + 1) / len(sinks) for index in range(len(sinks))]
    on_field = landings[0].site == "field"
    limit = acceptance.FIELD.sink_m_per_s if on_field else acceptance.RUNWAY.sink_m_per_s
    labels = ("sink (m/s)", "landings with at most this sink (%)")
    drawn = panel(span([0.0, limit * 1.2, *sinks]), (0.0, 104.0), labels, 26, 220)
    at = drawn.across.px(limit)
    parts = [*legend([("landings", BLUE, ""), ("largest acceptable sink", ORANGE, "6 3")], 14), *drawn.frame()]
    parts.append(f'<path class="series" stroke="{ORANGE}" stroke-dasharray="6 3" d="M{at:.1f},26V246"/>')
    parts.append(drawn.line(sinks, shares, BLUE))
    middle, late = sinks[len(sinks) // 2], sinks[min(int(0.95 * len(sinks)), len(sinks) - 1)]
    parts.append(text(980, 14, f"median {middle:.2f} m/s, 95 % at most {late:.2f} m/s", "end", "tick"))
    return picture(292, "sink at the touchdown", parts)


def _by_bias(landings: Sequence[Landing]) -> str:
    """Draw the share of acceptable landings against the constant error of the height, without its sign.

    The landings are put into bins of the error, each `_BIN_M` wide. Each share is drawn with its 95 % interval.
    A bin with fewer than `_FEWEST` flights is not drawn.
    """
    bins: dict[int, list[bool]] = {}
    for landing in landings:
        if landing.height_bias_m is not None:
            bins.setdefault(int(abs(landing.height_bias_m) / _BIN_M), []).append(not landing.causes)
    rows = [(_BIN_M * (n + 0.5), good) for n, good in sorted(bins.items()) if len(good) >= _FEWEST]
    labels = ("bias of height, without its sign (m)", "acceptable landings (%)")
    drawn = panel((0.0, max([middle for middle, _ in rows] or [1.0]) + _BIN_M), (0.0, 104.0), labels, 26, 220)
    entries = [("share of a bin", BLUE, "point"), ("its 95 % interval", GREEN, "")]
    parts = [*legend(entries, 14), *drawn.frame()]
    for middle, good in rows:
        low, high = interval(sum(good), len(good))
        x = drawn.across.px(middle)
        ends = drawn.up.px(100.0 * low), drawn.up.px(100.0 * high)
        parts.append(f'<path class="series" stroke="{GREEN}" d="M{x:.1f},{ends[0]:.1f}V{ends[1]:.1f}"/>')
        parts += drawn.points([middle], [100.0 * sum(good) / len(good)], BLUE)
        parts.append(text(x + 6, drawn.up.px(100.0 * sum(good) / len(good)) - 6, f"n={len(good)}", "start", "tick"))
    return picture(292, "bias of height against success", parts)
