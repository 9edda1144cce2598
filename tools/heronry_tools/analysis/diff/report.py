"""A difference as text, for a pull request, and as JSON, for a program.

The text has one line for each change: `+` for added, `-` for removed, `~` for changed. What did not change is left out.
"""

import json
from collections.abc import Iterator, Sequence

from heronry_dg.check.assess import Assessed
from heronry_dg.check.machine_reports import finding_fields
from heronry_dg.model import Spec
from heronry_dg.rules.rule import Severity
from heronry_tools.analysis.check.registry import RULES
from heronry_tools.analysis.diff.difference import Difference, Moved, PhaseDifference
from heronry_tools.analysis.diff.elements import ElementChange, FieldChange
from heronry_tools.analysis.diff.findings import FindingsChange
from heronry_tools.analysis.diff.in_flight import in_flight_lines

_SHOWN = 12  # digits of a digest
_SIGNS = {"added": "+", "removed": "-", "changed": "~"}


def text_report(found: Difference) -> str:
    """Write the difference between two specs as text for people, one line for each change."""
    if not found.elements:
        changed = list(_findings_lines(found.findings))
        what = "only the order of elements changed" if found.has_another_digest() else "nothing changed"
        lines = [f"{found.new.name}: {what}", _digest_line(found), *(["", *changed] if changed else [])]
        return "\n".join(lines) + "\n"
    counts = {change: sum(one.change == change for one in found.elements) for change in _SIGNS}
    said = ", ".join(f"{count} {change}" for change, count in counts.items() if count)
    lines = [f"{found.new.name}: {said}", _digest_line(found), ""]
    for element in found.elements:
        lines += _element_lines(element)
    for phase in found.phases:
        lines += ["", *_phase_lines(found, phase)]
    if found.in_flight is not None:
        lines += ["", *in_flight_lines(found.new, found.in_flight)]
    findings = list(_findings_lines(found.findings)) or [f"check: as before, {_counted(found.findings.stay)}"]
    return "\n".join([*lines, "", *findings]) + "\n"


def _digest_line(found: Difference) -> str:
    """Tell whether the digest of the spec changes, and what follows from that."""
    old, new = found.old.digest[:_SHOWN], found.new.digest[:_SHOWN]
    if not found.has_another_digest():
        return f"digest {old} as before: the tables, contingencies and journal of the old spec are taken"
    return (
        f"digest {old} -> {new}: PEs need new tables, contingencies are made anew, "
        "and the manager takes the old journal with --changed-spec"
    )


def _counted(count: int) -> str:
    return f"{count or 'no'} finding{'s' * (count != 1)}"


def _findings_lines(findings: FindingsChange) -> Iterator[str]:
    """Yield lines about new findings, errors first, and about findings that are gone."""
    for title, assessed in (("check says newly:", findings.new), ("check no longer says:", findings.old)):
        if assessed.findings:
            yield title
            for finding in sorted(assessed.findings, key=lambda one: one.severity is not Severity.ERROR):
                yield f"  {finding.code} {finding.severity}, line {finding.place.line}: {finding.sentence}"


def _element_lines(element: ElementChange) -> Iterator[str]:
    sign = _SIGNS[element.change]
    if element.change == "changed":
        yield f"{sign} {element.element}"
        for field in element.fields:
            yield f"    {field.field}: {_field_words(field)}"
    else:
        values = (f"{field.field} {field.new or field.old}" for field in element.fields)
        yield f"{sign} {element.element}  {'; '.join(values)}".rstrip()


def _field_words(field: FieldChange) -> str:
    return f"{field.old if field.old is not None else '(none)'} -> {field.new if field.new is not None else '(none)'}"


def _phase_lines(found: Difference, phase: PhaseDifference) -> Iterator[str]:
    where = f" in {_phase_name(phase.phase)}" if phase.phase is not None else ""
    if phase.phase != phase.against:
        where += f", against {_phase_name(phase.against)} before"
    if phase.is_none():
        yield f"consequences{where}: none"
        return
    yield f"consequences{where}:"
    for name, (was, becomes) in phase.functions.items():
        served = f"{_serving(found.old, name, was)} -> {_serving(found.new, name, becomes)}"
        yield f"  {_function_name(found, phase, name)}: {served}"
    for name, moved in phase.hangs_on.items():
        yield from _hangs_on_lines(_function_name(found, phase, name), moved)
    for bus, (load, becoming) in phase.buses.items():
        yield f"  bus {bus}: {_load(found.old, bus, load)} -> {_load(found.new, bus, becoming)}"
    if phase.cpu_millis[0] != phase.cpu_millis[1]:
        yield f"  CPU: {phase.cpu_millis[0] / 1000:g} -> {phase.cpu_millis[1] / 1000:g}"


def _phase_name(phase: str | None) -> str:
    return f"phase {phase}" if phase is not None else "no phases"


def _function_name(found: Difference, phase: PhaseDifference, name: str) -> str:
    spec = found.new if name in found.new.functions else found.old
    return f"{name} ({spec.functions[name].criticality_in(phase.phase)})"


def _serving(spec: Spec, name: str, served: str | None) -> str:
    if name not in spec.functions:
        return "(none)"
    return served if served is not None else "NOT SERVED"


def _hangs_on_lines(function: str, moved: Moved) -> Iterator[str]:
    if moved.new:
        yield f"  {function} now depends on {', '.join(moved.new)}"
    if moved.gone:
        still = f"; still on {', '.join(moved.left)}" if moved.left else ""
        yield f"  {function} no longer depends on {', '.join(moved.gone)}{still}"


def _load(spec: Spec, bus: str, bits_per_s: int) -> str:
    if bus not in spec.buses:
        return "(none)"
    return f"{bits_per_s} bit/s ({bits_per_s / spec.buses[bus].bitrate:.2%})"


def json_report(found: Difference) -> str:
    """Write a difference for programs; the same difference gives the same bytes."""
    document = {
        "old": {"name": found.old.name, "spec": found.old.digest},
        "new": {"name": found.new.name, "spec": found.new.digest},
        "same_digest": not found.has_another_digest(),
        "elements": [
            {
                "element": element.element,
                "change": element.change,
                "fields": [{"field": one.field, "old": one.old, "new": one.new} for one in element.fields],
            }
            for element in found.elements
        ],
        "phases": [
            {
                "phase": phase.phase,
                "against": phase.against,
                "functions": {name: _pair(pair) for name, pair in phase.functions.items()},
                "single_points_of_failure": {
                    name: {"gone": moved.gone, "new": moved.new, "left": moved.left}
                    for name, moved in phase.hangs_on.items()
                },
                "bus_bits_per_s": {name: _pair(pair) for name, pair in phase.buses.items()},
                "cpu_millis": _pair(phase.cpu_millis),
            }
            for phase in found.phases
        ],
        "in_flight": None if found.in_flight is None else found.in_flight.document(),
        "check": {
            "new": _findings_fields(found.findings.new),
            "gone": _findings_fields(found.findings.old),
        },
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _findings_fields(assessed: Assessed) -> list[dict[str, object]]:
    return [finding_fields(assessed, finding, RULES) for finding in assessed.findings]


def _pair(values: Sequence[object]) -> dict[str, object]:
    return {"old": values[0], "new": values[1]}
