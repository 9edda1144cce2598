"""Campaigns: many flights in parallel, and a table of the injected faults, by kind of fault and protocol state.

The number of flight hours says little. What counts is which kinds of faults were injected in which states of the
protocol (`Coverage`). The table has a cell for each kind in each state. A cell without an injection was never tried,
and a cell with fewer than `ENOUGH` injections was hardly tried. Drawn faults aim at every state (`drawing`).

Worker processes share nothing. Each process loads the spec once, and keeps plans for its later flights.
"""

import gc
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_tools.console.processes import held_back, in_order, processes
from heronry_tools.sim.faults.fault import KINDS, drawn_kinds
from heronry_tools.sim.faults.protocol_state import ORPHANED, STATES
from heronry_tools.sim.flight.outcome import Outcome

T = TypeVar("T")
R = TypeVar("R")

ENOUGH = 30
_HEAD_WIDTH = max(map(len, KINDS))
_POLITENESS = 10
_COLLECTED_AFTER = 100_000  # objects allocated and not freed since the last garbage collection
_SPECS: list[Spec] = []  # in a worker process: the one spec that it has loaded


def fly_all(spec_file: Path, flights: Sequence[T], jobs: int, fly: Callable[[Spec, T], R]) -> Iterator[R]:
    """Call `fly` for each flight, and yield the results in the order of the flights.

    The flights run in `jobs` processes, or in fewer if there are fewer flights. When the caller no longer iterates, the
    remaining flights are stopped. Raises UserError if a worker process has died.
    """
    jobs = min(jobs, len(flights))
    if jobs <= 1:
        spec = load(spec_file)
        collect_seldom()
        yield from (fly(spec, flight) for flight in flights)
        return
    with processes(jobs, _begin, spec_file) as executor:
        with held_back():
            flown = in_order(deque(executor.submit(_Flier(fly), flight) for flight in flights))
        yield from flown


def collect_seldom() -> None:
    """Make garbage collection rare, and exempt from collection all objects that exist now; both make flights faster."""
    gc.freeze()
    gc.set_threshold(_COLLECTED_AFTER)


class Coverage:
    """Counts injected faults by kind and protocol state, for the kinds that have a target in a spec."""

    def __init__(self, spec: Spec, *, of_two: bool = False) -> None:
        """Begin without flights; `of_two` tells whether the flights have two managers."""
        self.hits: Counter[tuple[str, str]] = Counter()
        self.entered: Counter[str] = Counter()
        self._unverified_ns: Counter[str] = Counter()
        self._flown_ns = 0
        self._kinds = drawn_kinds(spec, of_two=of_two, keyed=True)

    def add(self, outcome: Outcome) -> None:
        """Count the injections, entered states and waivers of one flight."""
        self.hits += outcome.hits
        self.entered += outcome.entered
        self._unverified_ns += outcome.unverified
        self._flown_ns += outcome.virtual_ns

    def unverified(self) -> dict[str, float]:
        """Return the share of the time in which each rule of an oracle was waived, in per cent, the largest first."""
        return {rule: round(100 * ns / self._flown_ns, 2) for rule, ns in self._unverified_ns.most_common()}

    def cells(self) -> dict[tuple[str, str], int]:
        """Return the number of injections in each cell (kind, state) that these flights can reach.

        A cell can be reached under two conditions:

        - its kind is drawn for this spec (the kind has a target there), or was injected in some flight
        - some flight has entered its state

        An order of the operator has no cell for the state without an active manager, since no order can be
        given in this state.
        """
        injected = {kind for kind, _ in self.hits}
        kinds = [*self._kinds, *(kind for kind in KINDS if kind in injected and kind not in self._kinds)]
        cells = [(kind, state) for kind in kinds for state in self._states()]
        orders = {kind for kind in kinds if KINDS[kind].is_order}
        return {cell: self.hits[cell] for cell in cells if cell[1] != ORPHANED or cell[0] not in orders}

    def table(self) -> list[str]:
        """Return the table as lines of text: how many faults were injected, by kind and state.

        Further lines give:

        - how often each state was entered
        - how many cells have too few faults, and the three with the fewest
        - in which share of the time each rule was waived
        """
        cells = self.cells()
        kinds = list(dict.fromkeys(kind for kind, _ in cells))
        lines = [_row("faults in state", STATES)]
        lines += [_row(kind, [cells.get((kind, state), "-") for state in STATES]) for kind in kinds]
        lines.append(_row("entered", [self.entered[state] for state in STATES]))
        thin = sorted((count, kind, state) for (kind, state), count in self._thin().items())
        least = "".join(f"; {kind} in {state}: {count}" for count, kind, state in thin[:3])
        lines.append(f"{len(thin)} of {len(cells)} cells have fewer than {ENOUGH} faults{least}")
        shares = ", ".join(f"{rule} {share:g}%" for rule, share in self.unverified().items())
        return [*lines, f"share of the time in which a rule was not verified: {shares}"] if shares else lines

    def document(self) -> dict[str, Any]:
        """Return the numbers of `table` as JSON data, without the three cells that have the fewest faults."""
        cells = self.cells()
        return {
            "cells": [{"kind": kind, "state": state, "count": count} for (kind, state), count in cells.items()],
            "entered": {state: self.entered[state] for state in STATES},
            "enough": ENOUGH,
            "thin": len(self._thin()),
            "unjudged_percent": self.unverified(),
        }

    def _thin(self) -> dict[tuple[str, str], int]:
        """Return the number of injections in each cell (kind of fault, state) that has fewer than `ENOUGH` of them."""
        return {cell: count for cell, count in self.cells().items() if count < ENOUGH}

    def _states(self) -> list[str]:
        return [state for state in STATES if self.entered[state] or any(self.hits[kind, state] for kind in KINDS)]


def _row(head: str, columns: Sequence[object]) -> str:
    return f"{head:{_HEAD_WIDTH}}" + "".join(f"{column!s:>11}" for column in columns)


def _begin(spec_file: Path) -> None:
    """Prepare this worker process: lower its priority, make garbage collection rare, load the spec."""
    os.nice(_POLITENESS)
    _SPECS.append(load(spec_file))
    collect_seldom()


class _Flier(Generic[T, R]):
    """Calls the function `fly` for a flight, in a worker process, with the spec that this process has loaded."""

    def __init__(self, fly: Callable[[Spec, T], R]) -> None:
        self._fly = fly

    def __call__(self, flight: T) -> R:
        return self._fly(_SPECS[0], flight)
