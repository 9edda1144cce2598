"""The report of one flight: the ground track, and panels over time for height, speeds, errors, loads and places.

The panel of places shows the PE and mode of each module. Marks (faults, reconfigurations, touchdown) are numbered lines
through all panels, and a table explains the numbers. In the panel of the height, shaded strips show the stages of the
landing or the phases. A panel without data is left out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from heronry_tools.fly import acceptance
from heronry_tools.fly.acceptance import Touchdown
from heronry_tools.fly.record import FlightRecord, Stretch
from heronry_tools.fly.report.axes import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LEFT,
    ORANGE,
    PURPLE,
    RIGHT,
    SKY,
    STYLE,
    WIDTH,
    Panel,
    Value,
    legend,
    panel,
    picture,
    span,
    text,
)

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GREY)
_STRIPES = ("#dbe9f6", "#fbe3d3", "#d9f0e7", "#f1e0ee", "#e8eaed", "#fff3c4")
_MARK_COLOUR = {"fault": ORANGE, "refused": ORANGE, "reconfigured": BLUE, "touchdown": GREEN, "note": GREY}
_FAR_M = 5_000.0  # a map that reaches further is in km
_LARGEST_ERROR_M = 12.0  # that a panel shows
_LONG_S = 900.0  # longer flights have their time in minutes
_AXES = (("x_m", "along"), ("y_m", "across"), ("height_m", "height"))


def flight_page(record: FlightRecord) -> str:
    """Return the HTML of a flight's report; equal records give equal bytes."""
    title = f"{record.spec}: {record.title}" if record.title else record.spec
    parts = [f"<h1>{escape(title)}</h1>", *_verdict(record)]
    if record.times_s:
        parts += ["<h2>Ground track</h2>", _ground_track(record), "<h2>Over time</h2>", _over_time(record)]
        parts += _table_of_marks(record)
    return page(title, parts)


def page(title: str, parts: Sequence[str]) -> str:
    """Return an HTML page that consists of `parts`; on a narrow screen each picture scrolls by itself."""
    parts = [f'<div class="wide" tabindex="0">{part}</div>' if part.startswith("<svg") else part for part in parts]
    narrow = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f'<meta charset="utf-8">{narrow}<title>{escape(title)}</title><style>{STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(parts) + "\n</body></html>\n"


def _verdict(record: FlightRecord) -> Iterator[str]:
    causes = record.causes
    kind, said = ("bad", "not acceptable: " + ", ".join(causes)) if causes else ("good", "acceptable")
    yield f'<p>Seed {record.seed}. Landing: <b class="{kind}">{said}</b>.</p>'
    landed = record.touchdown
    if landed is None:
        return
    rows = _on_runway(landed) if record.site == "runway" else _on_field(landed)
    yield f"<table><tr><th>touchdown at {landed.time_s:.1f} s</th><th></th><th></th><th>limit</th></tr>"
    for name, value, unit, limit in rows:
        yield f'<tr><td>{name}</td><td class="n">{value:.2f}</td><td>{unit}</td><td>{limit}</td></tr>'
    yield "</table>"


def _on_runway(landed: Touchdown) -> tuple[tuple[str, float, str, str], ...]:
    limits = acceptance.RUNWAY
    return (
        ("sink", landed.sink_m_per_s, "m/s", f"at most {limits.sink_m_per_s:g}"),
        ("along the runway", landed.x_m, "m", f"{limits.along_m[0]:g} to {limits.along_m[1]:g} from the aim"),
        ("off the centre line", landed.y_m, "m", f"at most {limits.offset_m:g}"),
        ("bank", landed.bank_deg, "deg", f"at most {limits.bank_deg:g}"),
        ("pitch", landed.pitch_deg, "deg", f"{limits.pitch_deg[0]:g} to {limits.pitch_deg[1]:g}"),
        ("airspeed", landed.airspeed_m_per_s, "m/s", ""),
    )


def _on_field(landed: Touchdown) -> tuple[tuple[str, float, str, str], ...]:
    limits, distance = acceptance.FIELD, math.hypot(landed.x_m, landed.y_m)
    return (
        ("sink", landed.sink_m_per_s, "m/s", f"at most {limits.sink_m_per_s:g}"),
        ("distance from home", distance, "m", f"at most {limits.distance_m:g}"),
        ("bank", landed.bank_deg, "deg", ""),
        ("airspeed", landed.airspeed_m_per_s, "m/s", ""),
    )


# The ground track


def _ground_track(record: FlightRecord) -> str:
    return _map(record) if record.site == "field" else _along_the_runway(record)


def _map(record: FlightRecord) -> str:
    """Draw a map, north up, with equal scales and with the circle in which a landing is acceptable."""
    norths, easts = record.columns["x_m"], record.columns["y_m"]
    is_far = max(abs(value or 0.0) for value in (*norths, *easts)) > _FAR_M
    unit, factor, height = ("km", 1e-3, 380.0) if is_far else ("m", 1.0, 480.0)
    up, across = (span([*values, 0.0], least=1200.0) for values in (norths, easts))
    wide = max(across[1] - across[0], (up[1] - up[0]) * (WIDTH - LEFT - RIGHT) / height)
    tall = wide * height / (WIDTH - LEFT - RIGHT)
    ends = [
        (factor * (sum(reach) - size) / 2, factor * (sum(reach) + size) / 2)
        for reach, size in ((across, wide), (up, tall))
    ]
    drawn = panel(ends[0], ends[1], (f"east of home ({unit})", f"north of home ({unit})"), 26, height)
    home = drawn.across.px(0.0), drawn.up.px(0.0)
    radius = drawn.across.px(factor * acceptance.FIELD.distance_m) - home[0]
    parts = [*legend([("truth", BLACK, "")], 14), *drawn.frame()]
    parts.append(f'<circle cx="{home[0]:.1f}" cy="{home[1]:.1f}" r="{radius:.1f}" fill="{GREEN}" fill-opacity="0.15"/>')
    scaled = [[None if value is None else factor * value for value in values] for values in (easts, norths)]
    parts.append(drawn.line(scaled[0], scaled[1], BLACK))
    if record.touchdown is not None:
        parts += drawn.points([factor * record.touchdown.y_m], [factor * record.touchdown.x_m], GREEN)
    said = f"green: {acceptance.FIELD.distance_m:g} m around home, and the touchdown"
    return picture(height + 72, "ground track", [*parts, text(WIDTH - RIGHT, 14, said, "end", "tick")])


def _along_the_runway(record: FlightRecord) -> str:
    columns = record.columns
    has_estimate = record.known("estimate_x_m") and record.known("estimate_y_m")
    aside = [*columns["y_m"], *(columns["estimate_y_m"] if has_estimate else ())]
    labels = ("x from the aim, along the landing direction (m)", "y, right of the centre line (m)")
    drawn = panel(span(columns["x_m"]), span(aside, least=20.0), labels, 26, 260)
    parts = [*legend([("truth", BLACK, ""), *([("estimate", BLUE, "6 3")] if has_estimate else [])], 14)]
    half, (first, last) = acceptance.RUNWAY.offset_m, acceptance.RUNWAY.along_m
    limits = (max(first, drawn.across.least), min(last, drawn.across.most))
    if limits[0] < limits[1]:
        parts += [drawn.box(limits, (-half, half), "#d9f0e7")]
    parts += drawn.frame()
    if has_estimate:
        parts.append(drawn.line(columns["estimate_x_m"], columns["estimate_y_m"], BLUE, "6 3"))
    parts.append(drawn.line(columns["x_m"], columns["y_m"], BLACK))
    if record.touchdown is not None:
        landed = record.touchdown
        parts += drawn.points([landed.x_m], [landed.y_m], GREEN)
        beside = -8 if drawn.across.px(landed.x_m) > WIDTH / 2 else 8
        anchor = "end" if beside < 0 else "start"
        place = drawn.across.px(landed.x_m) + beside, drawn.up.px(landed.y_m) - 8
        parts.append(text(*place, "touchdown", anchor))
    note = "the scales of the axes differ; green: where a landing is acceptable"
    parts.append(text(WIDTH - RIGHT, 14, note, "end", "tick"))
    return picture(330, "ground track", parts)


# Panels over time


@dataclass(frozen=True, slots=True)
class _Series:
    name: str
    values: Sequence[Value]
    colour: str
    dash: str = ""


@dataclass(frozen=True, slots=True)
class _Chart:
    """One panel over time: its lines, and, if `band` is given, the band between low and high values.

    least: the range of values that the panel shows is at least this wide
    height: in px
    """

    label: str
    series: tuple[_Series, ...]
    band: tuple[Sequence[Value], Sequence[Value]] | None = None
    least: float = 0.0
    height: float = 150.0


def _over_time(record: FlightRecord) -> str:
    minutes = record.times_s[-1] > _LONG_S
    factor, unit = (1.0 / 60.0, "min") if minutes else (1.0, "s")
    times = [time * factor for time in record.times_s]
    reach = (times[0], max(times[-1], times[0] + factor))
    parts, top = list[str](), 0.0
    for chart in _charts(record):
        parts += legend([(s.name, s.colour, s.dash) for s in chart.series] + _band_entry(chart), top + 14)
        drawn = panel(reach, _reach(chart), (f"time ({unit})", chart.label), top + 24, chart.height)
        parts += _stripes(record, drawn, factor) if not top else []
        parts += drawn.frame(names_across=False)
        if chart.band is not None:
            parts.append(drawn.band(times, *chart.band, BLUE))
        parts += (drawn.line(times, series.values, series.colour, series.dash) for series in chart.series)
        top += chart.height + 34
    lanes, height = _lanes(record, reach, factor, top)
    parts += lanes
    top += height
    axis = panel(reach, (0.0, 1.0), (f"time ({unit})", ""), 0, top)
    for value in axis.across.ticks(10):
        parts.append(text(axis.across.px(value), top + 8, f"{value:g}", "middle", "tick"))
    parts.append(text((LEFT + WIDTH - RIGHT) / 2, top + 26, f"time ({unit})", "middle"))
    parts += _marks(record, axis, factor, top)
    return picture(top + 34, "the flight over time", parts)


def _band_entry(chart: _Chart) -> list[tuple[str, str, str]]:
    return [] if chart.band is None else [("the filter's 3 sigma", BLUE, "band")]


def _reach(chart: _Chart) -> tuple[float, float]:
    values = [value for series in chart.series for value in series.values]
    if chart.band is None:
        return span(values, least=chart.least)
    # The range is symmetric around zero, contains the error and the median of the band, and ends at _LARGEST_ERROR_M.
    band = sorted(value for value in chart.band[1] if value is not None)
    usual = band[len(band) // 2] if band else 0.0
    far = max([chart.least / 2.0, 1.2 * usual, *(1.1 * abs(value) for value in values if value is not None)])
    return -min(far, _LARGEST_ERROR_M), min(far, _LARGEST_ERROR_M)


def _charts(record: FlightRecord) -> Iterator[_Chart]:
    columns, known = record.columns, record.known
    height = [_Series("height, truth", columns["height_m"], BLACK)]
    if known("estimate_height_m"):
        height.append(_Series("estimate", columns["estimate_height_m"], BLUE, "6 3"))
    yield _Chart("height (m)", tuple(height), least=10.0, height=220.0)
    vertical = [_Series("vertical speed, up", columns["up_m_per_s"], BLACK)]
    if known("commanded_up_m_per_s"):
        vertical.append(_Series("commanded", columns["commanded_up_m_per_s"], ORANGE, "6 3"))
    yield _Chart("speed (m/s)", tuple(vertical), least=2.0)
    air = [_Series("airspeed (true)", columns["airspeed_m_per_s"], BLACK)]
    for name, said, colour in (("measured_airspeed_m_per_s", "measured", BLUE), ("commanded_airspeed_m_per_s",
                               "commanded", ORANGE)):  # fmt: skip
        if known(name):
            air.append(_Series(said, columns[name], colour, "6 3"))
    yield _Chart("speed (m/s)", tuple(air), least=4.0)
    yield _Chart(
        "angle (deg)",
        (_Series("roll", columns["roll_deg"], BLUE), _Series("pitch", columns["pitch_deg"], ORANGE, "6 3")),
        least=10.0,
    )
    yield from _errors(record)
    surfaces = [name for name in columns if name in ("elevator_deg", "aileron_deg", "rudder_deg") and known(name)]
    if surfaces:
        yield _Chart("surface (deg)", _many(record, surfaces, "_deg"), least=10.0)
    loads = [name for name in columns if name.startswith("load_") and name != "load_factor_g" and known(name)]
    if loads:
        shares = {name: [None if v is None else 100.0 * v for v in columns[name]] for name in loads}
        series = tuple(
            _Series(name.removeprefix("load_"), shares[name], colour, "" if i == 0 else "6 3")
            for i, (name, colour) in enumerate(zip(loads, _COLOURS, strict=False))
        )
        yield _Chart("bus load (%)", series, least=10.0, height=110.0)


def _many(record: FlightRecord, names: Sequence[str], ending: str) -> tuple[_Series, ...]:
    dashes = ("", "6 3", "2 3")
    return tuple(
        _Series(name.removesuffix(ending), record.columns[name], colour, dash)
        for name, colour, dash in zip(names, _COLOURS, dashes, strict=False)
    )


def _errors(record: FlightRecord) -> Iterator[_Chart]:
    for name, said in _AXES:
        if not record.known(f"estimate_{name}"):
            continue
        estimate, truth = record.columns[f"estimate_{name}"], record.columns[name]
        error = [None if e is None or t is None else e - t for e, t in zip(estimate, truth, strict=True)]
        sigma = record.columns.get(f"sigma_{name}")
        band = None
        if sigma is not None and record.known(f"sigma_{name}"):
            high = [None if value is None else 3.0 * value for value in sigma]
            band = [None if value is None else -value for value in high], high
        yield _Chart(f"error, {said} (m)", (_Series("estimate minus truth", error, BLACK),), band, least=3.0)


# Stripes, lanes, marks


def _stripes(record: FlightRecord, drawn: Panel, factor: float) -> Iterator[str]:
    strips = [stretch for stretch in record.stretches if stretch.kind == "mode"]
    strips = strips or [stretch for stretch in record.stretches if stretch.kind == "phase"]
    labels = list(dict.fromkeys(strip.label for strip in strips))
    bottom, top = drawn.up.least, drawn.up.most
    for strip in strips:
        reach = strip.start_s * factor, max(strip.end_s * factor, drawn.across.least)
        fill = _STRIPES[labels.index(strip.label) % len(_STRIPES)]
        yield drawn.box((max(reach[0], drawn.across.least), reach[1]), (bottom, top), fill)
        left, right = drawn.across.px(max(reach[0], drawn.across.least)), drawn.across.px(reach[1])
        if right - left > 7.2 * len(strip.label):
            yield text(left + 5, drawn.up.end_px + 15, strip.label)


def _lanes(record: FlightRecord, reach: tuple[float, float], factor: float, top: float) -> tuple[list[str], float]:
    """Draw for each module a row that shows, over time, the PE and mode in which it ran.

    If some modules have moved, changed their mode, started after 0.5 s or ended more than 0.5 s before the last
    row of the record, only these modules get a row. Returns the elements of the picture, and their height in
    px; no elements and 0 if no module ran.

    reach: the range of the horizontal axis
    factor: converts seconds to the unit of this axis
    top: height at which the drawing begins, in px
    """
    lanes: dict[str, list[Stretch]] = {}
    for stretch in record.stretches:
        if stretch.kind == "place":
            lanes.setdefault(stretch.subject, []).append(stretch)
    moving = {subject: row for subject, row in lanes.items() if len({stretch.label for stretch in row}) > 1 or _ends(
        row, record.times_s[-1])}  # fmt: skip
    shown = moving or lanes
    if not shown:
        return [], 0.0
    title = "what ran where" + (" (only modules that moved, changed or ended)" if len(shown) < len(lanes) else "")
    parts, y = [text(LEFT, top + 14, title)], top + 22
    labels = list(dict.fromkeys(stretch.label for row in shown.values() for stretch in row))
    for subject, row in sorted(shown.items()):
        drawn = panel(reach, (0.0, 1.0), ("", ""), y, 18)
        is_named = False
        for stretch in row:
            fill = _STRIPES[labels.index(stretch.label) % len(_STRIPES)]
            begin, end = stretch.start_s * factor, stretch.end_s * factor
            parts.append(drawn.box((max(begin, reach[0]), max(end, reach[0])), (0.0, 1.0), fill))
            if (end - begin) / (reach[1] - reach[0]) * (WIDTH - LEFT - RIGHT) > 7.4 * (
                len(subject) + len(stretch.label) + 2
            ):
                parts.append(text(drawn.across.px(max(begin, reach[0])) + 4, y + 13, f"{subject}: {stretch.label}"))
                is_named = True
        if not is_named:
            ran = f"{subject}: {row[0].label} until {row[0].end_s:.1f} s"
            parts.append(
                text(drawn.across.px(min(max(row[0].end_s * factor, reach[0]), sum(reach) / 2)) + 4, y + 13, ran)
            )
        parts.append(f'<path class="grid" d="M{LEFT},{y + 20}H{WIDTH - RIGHT}"/>')
        y += 22
    return parts, y - top + 8


def _ends(row: Sequence[Stretch], end_s: float) -> bool:
    return row[0].start_s > 0.5 or row[-1].end_s < end_s - 0.5


def _marks(record: FlightRecord, axis: Panel, factor: float, bottom: float) -> Iterator[str]:
    taken = -100.0
    for index, mark in enumerate(record.marks, start=1):
        x = axis.across.px(min(max(mark.time_s * factor, axis.across.least), axis.across.most))
        colour = _MARK_COLOUR[mark.kind]
        dash = ' stroke-dasharray="3 3"' if mark.kind in ("reconfigured", "note") else ""
        yield f'<path d="M{x:.1f},24V{bottom - 6:.0f}" stroke="{colour}" stroke-width="1.2"{dash}/>'
        lower = 12 if x - taken < 16 else 0
        yield f'<rect x="{x - 8:.1f}" y="{50 + 2 * lower}" width="16" height="15" rx="3" fill="{colour}"/>'
        yield f'<text x="{x:.1f}" y="{62 + 2 * lower}" text-anchor="middle" style="fill:#fff">{index}</text>'
        taken = x if not lower else taken


def _table_of_marks(record: FlightRecord) -> Iterator[str]:
    if not record.marks:
        return
    yield "<table><tr><th>mark</th><th>time (s)</th><th>what happened</th></tr>"
    for index, mark in enumerate(record.marks, start=1):
        kind = f"{mark.kind}: " if mark.kind not in ("note", "touchdown") else ""
        said = escape(f"{kind}{mark.text}")
        yield f'<tr><td class="n">{index}</td><td class="n">{mark.time_s:.2f}</td><td>{said}</td></tr>'
    yield "</table>"
