"""Verification of a contingency file: every plan is verified, and its objective is computed again."""

from collections.abc import Iterator
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from itertools import islice
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, placement, score
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.planner.sweep import FaultSet, Phase
from heronry_tools.console.progress import Progress

_ENTRIES_IN_A_PART: Final = 256


@dataclass(frozen=True, slots=True)
class Entry:
    """One plan of a contingency file.

    what: in words: the fault set and the phase for which the plan was made; or, for a safe mode, its phase.
    now: the situation with these faults. configuration: the planned configuration.
    objective: the value of the plan according to the file; None for a safe mode, of which the file has no value.
    running: mode and PE of each module before the faults; None for a safe mode, and for a plan with nothing down.
    """

    what: str
    now: Situation
    configuration: Configuration
    objective: Objective | None
    running: Placement | None


def faults_of(spec: Spec, made: Contingencies, executor: Executor | None) -> list[str]:
    """Verify a contingency file; returns one sentence for each error, in the order of the file.

    executor: verifies the entries in worker processes; None: this process verifies them.
    """
    entries = iter(list(_entries(made)))
    parts = list(iter(lambda: list(islice(entries, _ENTRIES_IN_A_PART)), []))
    with Progress() as progress:
        progress.begin("entries verified", sum(map(len, parts)))
        if executor is None:
            found = []
            for part in parts:
                found.append(assessed(spec, part))
                progress.step(len(part))
        else:
            under_way = [executor.submit(assessed, spec, part) for part in parts]
            for done in as_completed(under_way):
                progress.step(len(parts[under_way.index(done)]))
            found = [one.result() for one in under_way]
    return [sentence for sentences in found for sentence in sentences]


def assessed(spec: Spec, entries: list[Entry]) -> list[str]:
    """Verify these entries of a contingency file; returns one sentence for each error."""
    return [f"{entry.what}: {wrong}" for entry in entries for wrong in _wrong(spec, entry)]


def _wrong(spec: Spec, entry: Entry) -> Iterator[str]:
    yield from map(str, verify(spec, entry.now, entry.configuration))
    if entry.objective is not None and score(spec, entry.now, entry.configuration, entry.running) != entry.objective:
        yield "the value of this plan is not the value in the file"


def _entries(made: Contingencies) -> Iterator[Entry]:
    running: dict[Phase, Placement] = {}
    for phase, down, plan in made.entries():
        configuration = made.configuration(plan.number)
        yield Entry(_named(phase, down), Situation(down, {}, phase), configuration, plan.objective, running.get(phase))
        running.setdefault(phase, placement(configuration))  # the first set of a phase is the empty one
    for table in made.phases:
        what = f"safe mode{_in(table.phase)}"
        yield Entry(what, Situation(phase=table.phase), made.configuration(table.safe_mode), None, None)


def _named(phase: Phase, down: FaultSet) -> str:
    return (", ".join(sorted(down)) or "nothing down") + _in(phase)


def _in(phase: Phase) -> str:
    return f" in {phase}" if phase is not None else ""
