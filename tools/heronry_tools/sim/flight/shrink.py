"""Shortens a failing list of faults as far as possible: delta debugging.

Each change of the list is tried in a flight. It is kept if this flight still fails in the same way.

1. Parts of the list are left out: halves at the beginning, then quarters, and so on down to single faults. At
   the end the flight fails with all faults that remain, and does not fail if any single one is left out.
2. Each fault is made simpler: it is injected at its time, whatever the state of the flight is, and it lasts less
   long.
3. The flight is made to end soon after its last fault.

If one fault is left out, another fault may meet another state of the flight. So the search may miss a shorter
list. But the random numbers of a fault do not depend on the other faults (`injection.schedule`).

Source: Zeller, Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE TSE 28 (2002). Step 1 is
their algorithm ddmin, without the steps that try one part of the list by itself.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

from heronry_tools.sim.faults.fault import Fault, over_s
from heronry_tools.sim.flight.outcome import Outcome, Scenario
from heronry_tools.sim.oracles.violation import MISSED


def shrunk(outcome: Outcome, fly: Callable[[Scenario], Outcome]) -> Outcome:
    """Return the shortest failing flight that the search finds.

    outcome: the result of the failing flight with which the search begins. fly: simulates a flight.
    """
    rules = {violation.rule for violation in outcome.violations} - {MISSED}
    best = _whole(outcome, fly, rules)
    parts = 2
    while len(best.scenario.faults) > 1:
        faults = best.scenario.faults
        smaller = _without_a_part(faults, parts, best.scenario, fly, rules)
        if smaller is not None:
            best, parts = smaller, max(parts - 1, 2)
        elif parts >= len(faults):
            break
        else:
            parts = min(2 * parts, len(faults))
    return _plainer(best, fly, rules)


def _whole(outcome: Outcome, fly: Callable[[Scenario], Outcome], rules: set[str]) -> Outcome:
    """Fly a failing scenario once more, long enough that all its faults are over, and return the result.

    Return `outcome` itself if its flight is long enough already, or if the longer flight does not fail.
    """
    scenario = replace(outcome.scenario, seconds=max(outcome.scenario.seconds, over_s(outcome.scenario.faults)))
    whole = outcome if scenario == outcome.scenario else fly(scenario)
    return whole if _fails(whole, rules) else outcome


def _plainer(best: Outcome, fly: Callable[[Scenario], Outcome], rules: set[str]) -> Outcome:
    """Make each fault simpler, and the flight shorter.

    A change is kept if the changed flight still breaks one of `rules`.
    """
    for position in range(len(best.scenario.faults)):
        for make_plain in (_without_state, _half_as_long, _half_as_long, _half_as_long):
            faults = best.scenario.faults
            plain = make_plain(faults[position])
            if plain == faults[position] or plain in faults:
                continue
            outcome = fly(replace(best.scenario, faults=(*faults[:position], plain, *faults[position + 1 :])))
            if _fails(outcome, rules):
                best = outcome
    scenario = best.scenario
    outcome = fly(replace(scenario, seconds=min(scenario.seconds, over_s(scenario.faults) + 1)))
    return outcome if _fails(outcome, rules) else best


def _without_state(fault: Fault) -> Fault:
    return replace(fault, during="")


def _half_as_long(fault: Fault) -> Fault:
    return replace(fault, lasts_ms=(fault.lasts_ms + 1) // 2)


def _fails(outcome: Outcome, rules: set[str]) -> bool:
    return any(violation.rule in rules for violation in outcome.violations)


def _without_a_part(
    faults: tuple[Fault, ...], parts: int, scenario: Scenario, fly: Callable[[Scenario], Outcome], rules: set[str]
) -> Outcome | None:
    """Divide `faults` into `parts` parts, and leave out each of them in turn.

    Returns the first flight that still breaks one of `rules`; None: no flight does.
    """
    bounds = [len(faults) * i // parts for i in range(parts + 1)]
    for begin, end in pairwise(bounds):
        outcome = fly(replace(scenario, faults=faults[:begin] + faults[end:], drawn=False))
        if _fails(outcome, rules):
            return outcome
    return None
