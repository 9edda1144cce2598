"""The report of `heronry campaign`, as text and as JSON."""

import json
from collections.abc import Iterator, Sequence
from math import isinf

from heronry_dg.model import Spec
from heronry_manager.planner.sweep import Scope
from heronry_tools.analysis.campaign.outlook import Outlook
from heronry_tools.analysis.campaign.requirements import Offence, Requirement
from heronry_tools.analysis.campaign.survey import Grade, PhaseSurvey, Range

Assessed = Sequence[tuple[Requirement, list[Offence]]]
_OFFENCES_SHOWN = 20
_UTILITIES_SHOWN = 5


def text_report(spec: Spec, scope: Scope, surveys: Sequence[PhaseSurvey], assessed: Assessed) -> str:
    """Write a campaign as text: tables for each phase, and whether each requirement holds."""
    kinds = f"up to {scope.faults} faults of {len(scope.elements)} elements"
    lines = [f"{spec.name}: {kinds}, {scope.set_count()} fault sets in each phase"]
    for one in surveys:
        lines += ["", *_phase_lines(one)]
    if assessed:
        lines.append("")
    for requirement, broken in assessed:
        lines += _requirement_lines(requirement, broken)
    return "\n".join(lines) + "\n"


def _phase_lines(one: PhaseSurvey) -> Iterator[str]:
    yield f"phase {one.phase}" if one.phase is not None else "every fault set"
    of = sum(level != "E" for level in one.wanted.values())
    rows = [("faults", "sets", "utility: best", "mean", "worst", f"critical of {of}: best", "mean", "worst")]
    for grade in one.grades:
        utility, critical = _in_words(grade.utility), _in_words(grade.critical)
        rows.append((str(grade.faults), str(grade.sets), *utility, *critical))
    yield from aligned(rows)
    yield ""
    sizes = [f"{grade.sets} of {grade.faults}" for grade in one.grades]
    lost_in = (f"lost in {size}" for size in sizes)
    rows2 = [("function", "class", *lost_in, *likely_heads(one), "lost alone with")]
    for name, level in one.wanted.items():
        counts = [str(grade.lost[name]) for grade in one.grades]
        rows2.append((name, level, *counts, *likely_cells(one, name), ", ".join(one.single_points[name]) or "-"))
    yield from aligned(rows2)
    if one.outlook is not None:
        yield ""
        yield from outlook_lines(one.outlook)
    unproven = sum(grade.unproven for grade in one.grades)
    if unproven:
        yield f"{unproven} plans are legal, but not proven to be the best"


def likely_heads(one: PhaseSurvey) -> tuple[str, ...]:
    """Return the heads of the columns that say how likely a function is lost."""
    return ("loss",) if one.outlook is None else (f"lost within {one.outlook.hours:g} h", "mean time to loss")


def likely_cells(one: PhaseSurvey, function: str) -> tuple[str, ...]:
    """Return the cells of these columns, each of which says what its number is; `-` where nothing is known."""
    if one.outlook is None:
        return ("-",)
    mean = one.outlook.mean_times_h.get(function)
    lasts = "-" if mean is None else "infinite (upper)" if isinf(mean) else f"{mean:.4g} h (upper)"
    return str(one.outlook.losses.get(function, "-")), lasts


def outlook_lines(outlook: Outlook) -> Iterator[str]:
    """Write what utility is to be expected, and how likely it is."""
    low, high = outlook.expected
    expected = f"{low:.6g} (lower) to {high:.6g} (upper)" if high - low > 1e-9 * high else f"{low:.6g} (exact)"
    yield f"within {outlook.hours:g} h, without repair: expected utility {expected}, by plans to order {outlook.order}"
    likely = sorted(outlook.utilities, key=lambda one: -one[1])[:_UTILITIES_SHOWN]
    shown = ", ".join(
        f"{utility} with {chance:.4g}" for utility, chance in sorted(likely, reverse=True) if chance > 0.0
    )
    yield f"utility (exact): {shown}; not known with {outlook.beyond:.2g}"
    if outlook.without_rate:
        yield f"{outlook.without_rate} elements have no rate, and count as never down"


def _in_words(values: Range) -> tuple[str, str, str]:
    return str(values.best), f"{values.mean:.1f}", str(values.worst)


def _requirement_lines(requirement: Requirement, broken: list[Offence]) -> Iterator[str]:
    if not broken:
        yield f"required: {requirement.text}: holds"
        return
    yield f"required: {requirement.text}: BROKEN by {len(broken)} smallest fault sets"
    for one in broken[:_OFFENCES_SHOWN]:
        where = f" in {one.phase}" if one.phase is not None else ""
        yield f"  {', '.join(sorted(one.down)) or 'nothing down'}{where}: {', '.join(one.functions)}"
    if len(broken) > _OFFENCES_SHOWN:
        yield f"  and {len(broken) - _OFFENCES_SHOWN} more (--json lists all)"


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Write rows as lines of text with aligned columns."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, [*widths, 0], strict=True)).rstrip()


def json_report(spec: Spec, scope: Scope, surveys: Sequence[PhaseSurvey], assessed: Assessed) -> str:
    """Write all results of a campaign as JSON."""
    document = {
        "spec": spec.name,
        "digest": spec.digest,
        "faults": scope.faults,
        "elements": list(scope.elements),
        "phases": [_phase_json(one) for one in surveys],
        "requirements": [
            {
                "text": requirement.text,
                "holds": not broken,
                "broken_by": [
                    {"phase": one.phase, "down": sorted(one.down), "functions": list(one.functions)} for one in broken
                ],
            }
            for requirement, broken in assessed
        ],
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _phase_json(one: PhaseSurvey) -> dict[str, object]:
    return {
        "phase": one.phase,
        "by_faults": [_grade_json(grade) for grade in one.grades],
        "functions": {
            name: {
                "class": level,
                "lost": [grade.lost[name] for grade in one.grades],
                "single_points": list(one.single_points[name]),
                **_loss_json(one.outlook, name),
            }
            for name, level in one.wanted.items()
        },
        "outlook": None if one.outlook is None else _outlook_json(one.outlook),
    }


def _loss_json(outlook: Outlook | None, function: str) -> dict[str, object]:
    per_h = None if outlook is None else outlook.losses_per_h.get(function)
    loss = None if outlook is None else outlook.losses.get(function)
    mean = None if outlook is None else outlook.mean_times_h.get(function)
    return {
        "loss_per_h": None if per_h is None else per_h.low,
        "loss_at_most_per_h": None if per_h is None else per_h.high,
        "loss_is_complete": None if per_h is None else per_h.high is not None,
        "loss": None if loss is None else {"at_least": loss.low, "at_most": loss.high, "exact": loss.exact},
        "reliability": None if outlook is None or loss is None else _curve_json(outlook, function),
        "mean_time_to_loss_at_most_h": None if mean is None or isinf(mean) else mean,
    }


def _curve_json(outlook: Outlook, function: str) -> list[dict[str, float | None]]:
    """Return R(t), with its bounds, at the times of the curve."""
    return [
        {"hours": time, "at_least": None if loss.high is None else 1.0 - loss.high, "at_most": 1.0 - loss.low}
        for time, loss in outlook.curves[function]
    ]


def _outlook_json(outlook: Outlook) -> dict[str, object]:
    return {
        "mission_h": outlook.hours,
        "order": outlook.order,
        "expected_utility": {"at_least": outlook.expected[0], "at_most": outlook.expected[1]},
        "utility": [{"utility": utility, "probability": chance} for utility, chance in outlook.utilities],
        "not_known": outlook.beyond,
        "elements_without_rate": outlook.without_rate,
    }


def _grade_json(grade: Grade) -> dict[str, object]:
    return {
        "faults": grade.faults,
        "sets": grade.sets,
        "utility": _range_json(grade.utility),
        "critical": _range_json(grade.critical),
        "unproven": grade.unproven,
    }


def _range_json(values: Range) -> dict[str, float]:
    return {"best": values.best, "mean": values.mean, "worst": values.worst}
