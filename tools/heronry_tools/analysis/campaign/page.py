"""A campaign as one page: pictures of graceful degradation, and tables, in a single file that needs no other file.

A picture has the number of faults on its horizontal axis. On its vertical axis it has what is left, in per cent of the
healthy system. An area reaches from the worst to the best case, and a line shows the mean. The style sheet has a light
and a dark set of colours; the setting of the reader's browser chooses one.
"""

from collections.abc import Callable, Iterator, Sequence
from html import escape
from typing import Final

from heronry_dg.model import Spec
from heronry_manager.planner.sweep import Scope
from heronry_tools.analysis.campaign.chart import Chart
from heronry_tools.analysis.campaign.outlook_picture import outlook_picture, reliability_picture
from heronry_tools.analysis.campaign.report import Assessed, likely_cells, likely_heads, outlook_lines
from heronry_tools.analysis.campaign.survey import Grade, PhaseSurvey, Range

_STYLE: Final = """\
:root { color-scheme: light dark; --ink: #1d2430; --paper: #ffffff; --faint: #5c6675; --line: #d5dae1;
  --area: #b9d3ee; --mean: #12508f; --bad: #a8201a; --good: #1c6b3c; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ee; --paper: #14181f; --faint: #9aa5b5; --line: #343c48;
  --area: #274563; --mean: #8cc2f7; --bad: #ff9a8f; --good: #86d8a4; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 66em;
  margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.2em; margin-top: 2em; border-top: 1px solid var(--line); padding-top: 1em; }
.pictures { display: flex; flex-wrap: wrap; gap: 1em; } figure { margin: 0; } figcaption { color: var(--faint); }
.tables { overflow-x: auto; } table { border-collapse: collapse; margin: 1em 0; }
td, th { padding: .2em .8em .2em 0; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
.bad { color: var(--bad); } .good { color: var(--good); } .faint { color: var(--faint); }
svg text { fill: var(--ink); font: 12px system-ui, sans-serif; } svg .faint { fill: var(--faint); }
svg .grid { stroke: var(--line); } svg .area { fill: var(--area); } svg .dot { fill: var(--mean); }
svg .mean { stroke: var(--mean); stroke-width: 2; fill: none; }
"""


def html_page(spec: Spec, scope: Scope, surveys: Sequence[PhaseSurvey], assessed: Assessed) -> str:
    """Return the page of a campaign as HTML: the requirements, then pictures and tables for each phase."""
    title = escape(f"{spec.name}: what survives up to {scope.faults} faults")
    covered = (
        f"{scope.set_count()} sets of up to {scope.faults} faults of {len(scope.elements)} elements in each phase; "
        f"every set of a size counts alike. Spec {escape(spec.digest[:12])}."
    )
    parts = [
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>\n{_STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>",
        f'<p class="faint">{covered}</p>',
        *_requirements(assessed),
        *(line for one in surveys for line in _phase(one)),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _requirements(assessed: Assessed) -> Iterator[str]:
    if not assessed:
        return
    yield "<h2>Required</h2>\n<ul>"
    for requirement, broken in assessed:
        if not broken:
            yield f'<li>{escape(requirement.text)}: <span class="good">holds</span></li>'
            continue
        count = f"broken by {len(broken)} smallest fault sets"
        yield f'<li>{escape(requirement.text)}: <span class="bad">{count}</span><ul>'
        for one in broken:
            where = f" in {one.phase}" if one.phase is not None else ""
            sets = ", ".join(sorted(one.down)) or "nothing down"
            yield "<li>" + escape(f"{sets}{where}: {', '.join(one.functions)}") + "</li>"
        yield "</ul></li>"
    yield "</ul>"


def _phase(one: PhaseSurvey) -> Iterator[str]:
    yield f"<h2>{escape(f'Phase {one.phase}' if one.phase is not None else 'Degradation')}</h2>"
    yield '<div class="pictures">'
    yield _picture("Utility", one.grades, lambda grade: grade.utility)
    yield _picture("Critical functions served", one.grades, lambda grade: grade.critical)
    if one.outlook is not None:
        yield outlook_picture(one.outlook)
        yield reliability_picture(one.outlook)
    yield "</div>"
    if one.outlook is not None:
        yield from (f"<p>{escape(line)}</p>" for line in outlook_lines(one.outlook))
    yield '<div class="tables">'
    heads = ("faults", "sets", "utility: best", "mean", "worst", "critical served: best", "mean", "worst")
    yield _table(heads, [_grade_row(grade) for grade in one.grades])
    sizes = (f"lost in {grade.sets} sets of {grade.faults}" for grade in one.grades)
    of_functions = ("function", "class", *sizes, *likely_heads(one), "lost alone with")
    yield _table(of_functions, list(_function_rows(one)))
    yield "</div>"


def _grade_row(grade: Grade) -> list[str]:
    ranges = [text for one in (grade.utility, grade.critical) for text in (one.best, f"{one.mean:.1f}", one.worst)]
    return [str(cell) for cell in (grade.faults, grade.sets, *ranges)]


def _function_rows(one: PhaseSurvey) -> Iterator[list[str]]:
    for name, level in one.wanted.items():
        counts = [str(grade.lost[name]) for grade in one.grades]
        yield [name, level, *counts, *likely_cells(one, name), ", ".join(one.single_points[name]) or "-"]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["<table>", "<tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>"]
    lines += ["<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])


def _cell(text: str) -> str:
    kind = ' class="number"' if text.replace(".", "").isdecimal() else ""
    return f"<td{kind}>{escape(text)}</td>"


def _picture(title: str, grades: Sequence[Grade], quantity: Callable[[Grade], Range]) -> str:
    whole = max(1, quantity(grades[0]).best)
    steps = max(1, len(grades) - 1)

    def point(number: int, value: float) -> tuple[float, float]:
        # a lost function may make room for another one; the picture ends at the top
        return number / steps, min(value / whole, 1.0)

    ranges = [quantity(grade) for grade in grades]
    middle = [point(i, one.mean) for i, one in enumerate(ranges)]
    chart = Chart(f"{title} by number of faults", "faults at once")
    for quarter in range(5):
        chart.grid_line(quarter / 4, f"{25 * quarter} %")
    chart.area(
        [point(i, one.worst) for i, one in enumerate(ranges)], [point(i, one.best) for i, one in enumerate(ranges)]
    )
    chart.line(middle)
    for place, one in zip(middle, ranges, strict=True):
        chart.dot(place, f"mean {one.mean / whole:.1%}")
    for i, grade in enumerate(grades):
        chart.tick(i / steps, str(grade.faults))
    return chart.text(f"{title}: worst to best, and mean, of the healthy {whole}")
