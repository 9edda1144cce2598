"""A sweep put together: a crew that plans, a journal that keeps, progress on the screen."""

from collections.abc import Iterator
from concurrent.futures import Executor

from heronry_dg.model import Spec
from heronry_manager.contingency.journal import Journal
from heronry_manager.planner.sweep import Answer, Question, Scope, Sweep
from heronry_tools.campaign.crew import answers
from heronry_tools.progress import Progress


def sweep(spec: Spec, scope: Scope, executor: Executor | None, journal: Journal | None = None) -> Sweep:
    """Plan for every fault set of a scope; what a journal knows already is not planned again."""
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
