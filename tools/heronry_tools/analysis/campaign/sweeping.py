"""A sweep: the plan for every fault set of a scope.

Workers make the plans. A journal keeps the plans, so that a killed run can be continued. The screen shows the progress.
At the end the plans are written to a contingency file.
"""

import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from heronry_dg.model import Spec
from heronry_manager.contingency.contingencies import Contingencies, contingencies
from heronry_manager.contingency.file_format import to_bytes
from heronry_manager.contingency.journal import Journal
from heronry_manager.planner.sweep import Answer, Question, Scope, Sweep, Tally
from heronry_tools.analysis.campaign.crew import answers
from heronry_tools.console.progress import Progress
from heronry_tools.console.whole_file import expect_writable, write_whole


@dataclass(frozen=True, slots=True)
class Written:
    """A contingency file that was written: its content, its size in bytes, and how the plans were found."""

    made: Contingencies
    size: int
    tally: Tally


def sweep(spec: Spec, scope: Scope, executor: Executor | None, journal: Journal | None = None) -> Sweep:
    """Make the plan for every fault set of a scope, in each phase of the scope.

    executor: makes the plans; None: this process makes them.
    journal: gives the plans that it already has, and keeps each new one; None: every plan is made anew.
    """
    known = {} if journal is None else journal.known
    swept = Sweep(spec, scope)

    with Progress() as progress:

        def ask(size: int, questions: list[Question]) -> Iterator[Answer]:
            progress.begin(f"plans for {size} faults" if size != 1 else "plans for 1 fault", len(questions))
            unknown = []
            for question in questions:
                found = known.get((question.phase, question.down))
                if found is None:
                    unknown.append(question)
                else:
                    yield question, found
            progress.step(len(questions) - len(unknown))
            for question, outcome in answers(spec, executor, unknown):
                if journal is not None:
                    journal.add(question.phase, question.down, outcome)
                progress.step()
                yield question, outcome

        swept.run(ask)
    return swept


def numbered(spec: Spec, scope: Scope, swept: Sweep) -> Contingencies:
    """Number the configurations that a sweep of this scope has found, and add the safe mode of each phase."""
    from heronry_manager.planner.safe_mode import safe_mode  # noqa: PLC0415 - verifying alone needs no solver

    safe_modes = {phase: safe_mode(spec, phase, swept.running(phase) or {}) for phase in scope.phases}
    return contingencies(spec, scope, swept.outcomes, safe_modes)


def partial_of(file: Path) -> Path:
    """Return the journal of a contingency file: the file in which a run keeps its plans until the run is complete."""
    return file.with_name(f"{file.name}.partial")


def sweep_into(file: Path, spec: Spec, scope: Scope, executor: Executor | None) -> Written:
    """Write the contingency file of a scope; continues the journal FILE.partial that a killed run has left.

    Raises UserError if the contingency file cannot be written. Raises JournalError while another run writes
    the journal, or if the journal cannot be written.
    """
    expect_writable(file)
    with Journal(partial_of(file), spec, scope) as journal:
        if journal.known:
            print(f"heronry: continuing {journal.file}, which has {len(journal.known)} plans", file=sys.stderr)
        try:
            swept = sweep(spec, scope, executor, journal)
        except KeyboardInterrupt:
            print(f"heronry: stopped; the same command continues from {journal.file}", file=sys.stderr)
            raise
        made = numbered(spec, scope, swept)
        data = to_bytes(made, spec)
        write_whole(file, data)
        journal.remove()
    return Written(made, len(data), swept.tally)
