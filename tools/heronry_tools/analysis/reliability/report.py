"""The report of `heronry cutsets`: cut sets and probabilities, as text and as JSON. Each number says what it is."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isinf
from typing import Any, Final

from heronry_dg.model import Spec
from heronry_manager.planner.sweep import FaultSet, Scope
from heronry_tools.analysis.reliability.bounds import Bounds, loss_bounds
from heronry_tools.analysis.reliability.curve import curve_lines
from heronry_tools.analysis.reliability.cut_sets import CutSets
from heronry_tools.analysis.reliability.diagrams import MOST_NODES, MOST_SECONDS
from heronry_tools.analysis.reliability.mission import Reliability

_POINTS: Final = 20  # of R(t) in JSON
_COLUMNS: Final = 48  # steps of R(t) in the text
_MOST_IMPORTANT: Final = 5  # elements whose importance the text has
_FEW: Final = 4  # elements without a rate that are named


@dataclass(frozen=True)
class Findings:
    """What `heronry cutsets` has found about one function, and how it is to be shown.

    cuts: None: only the logic was asked for.
    given_up: sets after which the best plan leaves the function out; None: not asked for.
    hours: the length of the mission. order: largest order of logical sets that are listed; None: every order.
    most: most logical sets that are listed. likeliest: list the likeliest first.
    """

    spec: Spec
    function: str
    scope: Scope
    logic: Reliability
    cuts: CutSets | None
    given_up: list[FaultSet] | None
    hours: float
    order: int | None
    most: int
    likeliest: bool = False

    @cached_property
    def logical(self) -> tuple[FaultSet, ...]:
        """The logical cut sets that are listed."""
        if not self.likeliest:
            return tuple(self.logic.sets.sets(self.most, self.order))
        return tuple(down for down, _ in self.logic.sets.likeliest(self.most, self.element_chances(self.hours)))

    def element_chances(self, hours: float) -> dict[str, float]:
        """Return the probability of each element that it is down after so many hours, for whatever cause."""
        known = self.logic.hazards
        alone = type(known)(known.rates, known.demands)
        return alone.chances(hours)

    def has_chances(self, sets: Sequence[FaultSet] | None = None) -> bool:
        """Tell whether a cut set is known of which each element has a rate or a probability."""
        if sets is not None:
            return any(self.logic.hazards.known() >= down for down in sets)
        return self.logic.loss_at_most(1e9) > 0.0

    def loss(self, hours: float) -> Bounds:
        """Return the probability of loss by logic."""
        return Bounds(self.logic.loss(hours), None if self.logic.unknown else self.logic.loss_at_most(hours))

    def bounds(self, hours: float) -> Bounds:
        """Return the bounds of the probability of loss with real resources."""
        assert self.cuts is not None
        return loss_bounds(self.logic.failure, self.cuts.resources, self.cuts.order, self.logic.hazards, hours)


def text_report(found: Findings) -> str:
    """Write the findings as text."""
    upto = f"sets of up to {found.scope.faults} faults" if found.cuts is not None else "logical sets"
    lines = [f"{found.function} of {found.spec.name}: {upto}", "", *_logical_lines(found)]
    if found.cuts is not None:
        lines += ["", *_resource_lines(found, found.cuts)]
    if found.given_up is not None:
        (phase,) = found.scope.phases
        where = f" in {phase}" if phase is not None else ""
        lines += ["", f"given up by the best plan{where}: {_counted(len(found.given_up))}"]
        lines += map(_set_line, found.given_up)
    return "\n".join(lines) + "\n"


def _logical_lines(found: Findings) -> Iterator[str]:
    by_order = found.logic.sets.by_order()
    total = sum(by_order.values())
    if 0 in by_order:
        yield "logical: with nothing down at all"
        yield _set_line(frozenset())
        return
    orders = ", ".join(f"{number} of {order}" for order, number in by_order.items())
    upto = found.logic.sets.order
    extent = "in all" if upto is None else f"to order {upto}; larger ones are not known"
    yield f"logical: {_counted(total)}" + (f" {extent} ({orders})" if total else "" if upto is None else f" {extent}")
    if not found.logic.exact:
        limits = f"more than {MOST_NODES} nodes, or {MOST_SECONDS:g} s of CPU"
        yield f"  its diagram is too large, or took too long ({limits}): numbers below are bounds"
    listed = found.logical
    if found.likeliest:
        chances = found.element_chances(found.hours)
        yield from (f"  {_together(down, chances):.2e}  {_named(down)}" for down in listed)
    else:
        yield from map(_set_line, listed)
    if len(listed) < total:
        yield f"  ... {total - len(listed)} more (--logical lists every order, --list N more sets)"
    if total and found.has_chances():
        yield from _probability_lines(found)


def _probability_lines(found: Findings) -> Iterator[str]:
    loss, unknown = found.loss(found.hours), found.logic.unknown
    yield f"lost by logic within {found.hours:g} h: {loss}" + (f"; {_without_rates(unknown)}" if unknown else "")
    mean = found.logic.mean_time_to_failure()
    what = "exact" if not unknown and found.logic.exact else "upper"
    yield f"mean time to loss: {'infinite' if isinf(mean) else f'{mean:.4g} h'} ({what}; without repair)"
    yield f"R(t) by logic ({what}):"
    yield from curve_lines([found.logic.loss(found.hours * n / _COLUMNS) for n in range(_COLUMNS + 1)], found.hours)
    most = list(found.logic.importance(found.hours).items())[:_MOST_IMPORTANT]
    shares = ", ".join(f"{name} {its.fussell_vesely:.1%}" for name, its in most if its.fussell_vesely > 0.0)
    of_what = "" if found.logic.exact else ", of the lower bound"
    yield f"most important (Fussell-Vesely{of_what}): {shares}"


def _without_rates(unknown: Sequence[str]) -> str:
    more = f" and {len(unknown) - _FEW} more" if len(unknown) > _FEW else ""
    return f"no rate is known of {', '.join(unknown[:_FEW])}{more}"


def _resource_lines(found: Findings, cuts: CutSets) -> Iterator[str]:
    logical = set(cuts.logical)
    more = [down for down in cuts.resources if down not in logical]
    if frozenset() in cuts.resources and frozenset() not in logical:
        yield "resource-aware: with nothing down at all"
        yield _set_line(frozenset())
        return
    if logical and not more:
        yield "resource-aware: the same sets"
    else:
        yield f"resource-aware: {_counted(len(more), more=bool(logical))}"
        yield from map(_set_line, more)
    if cuts.resources and found.has_chances(cuts.resources):
        yield f"lost with real resources within {found.hours:g} h: {found.bounds(found.hours)}, to order {cuts.order}"


def _counted(number: int, *, more: bool = False) -> str:
    return f"{number or 'no'}{' more' * more} set{'s' * (number != 1)}"


def _named(down: FaultSet) -> str:
    return ", ".join(sorted(down)) or "nothing down"


def _set_line(down: FaultSet) -> str:
    return f"  {_named(down)}"


def _together(down: FaultSet, chances: dict[str, float]) -> float:
    found = 1.0
    for element in down:
        found *= chances.get(element, 0.0)
    return found


def json_report(found: Findings) -> str:
    """Write the findings as JSON."""
    document: dict[str, Any] = {
        "spec": found.spec.name,
        "digest": found.spec.digest,
        "function": found.function,
        "order": found.scope.faults,
        "mission_h": found.hours,
        "logical": _logical_json(found),
    }
    if found.cuts is not None:
        document["resources"] = _resources_json(found, found.cuts)
    if found.given_up is not None:
        nothing = {"per_h": None, "at_most_per_h": None, "complete": None}
        sets = [sorted(down) for down in found.given_up]
        document["given_up"] = {"phase": found.scope.phases[0], "sets": sets, **nothing}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _logical_json(found: Findings) -> dict[str, Any]:
    by_order = found.logic.sets.by_order()
    known = found.has_chances()
    document = {
        "count": sum(by_order.values()),
        "complete_to_order": found.logic.sets.order,
        "by_order": {str(order): number for order, number in by_order.items()},
        "sets": [sorted(down) for down in found.logical],
        **_per_hour(found.loss(1.0) if known else None),
        "probability": _bounds_json(found.loss(found.hours) if known else None),
    }
    if known:
        mean = found.logic.mean_time_to_failure()
        document |= {
            "without_rate": found.logic.unknown,
            "mean_time_to_loss_h": None if isinf(mean) else mean,
            "reliability": [list(point) for point in found.logic.curve(found.hours, _POINTS)],
            "importance": {
                name: {"birnbaum": its.birnbaum, "fussell_vesely": its.fussell_vesely}
                for name, its in found.logic.importance(found.hours).items()
            },
        }
    return document


def _resources_json(found: Findings, cuts: CutSets) -> dict[str, Any]:
    known = found.has_chances(cuts.resources) or found.has_chances()
    return {
        "sets": [sorted(down) for down in cuts.resources],
        **_per_hour(found.bounds(1.0) if known else None),
        "probability": _bounds_json(found.bounds(found.hours) if known else None),
    }


def _per_hour(loss: Bounds | None) -> dict[str, Any]:
    if loss is None:
        return {"per_h": None, "at_most_per_h": None, "complete": None}
    return {"per_h": loss.low, "at_most_per_h": loss.high, "complete": loss.high is not None}


def _bounds_json(loss: Bounds | None) -> dict[str, Any] | None:
    return None if loss is None else {"at_least": loss.low, "at_most": loss.high, "exact": loss.exact}
