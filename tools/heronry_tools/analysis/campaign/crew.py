"""The workers that make the plans of a campaign: this process itself, its worker processes, or a Dask cluster.

A *question* asks for the plan of one fault set. A *task* has some questions about one phase of a spec. The function
`solved` answers a task. Its argument and its result can be pickled, so any `concurrent.futures.Executor` can run it,
also that of a cluster. The process that makes a plan also verifies the plan.

`heronry_tools.console.processes` says how worker processes start and end.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Final

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.planner.sweep import Answer, FaultSet, Outcome, Phase, Question
from heronry_tools.console.errors import UserError
from heronry_tools.console.processes import held_back, processes

if TYPE_CHECKING:
    from heronry_manager.planner.exact import Planner

_QUESTIONS_IN_A_TASK: Final = 8


@dataclass(frozen=True, slots=True)
class Task:
    """Questions about one phase of a spec.

    running: mode and PE of each module that runs before the faults; None: they are not known.
    downs: the fault set of each question.
    """

    spec: Spec
    phase: Phase
    running: Placement | None
    downs: tuple[FaultSet, ...]


_warm: list["Planner"] = []  # the planner of this process, from its first task on


def solved(task: Task) -> list[Outcome]:
    """Answer all questions of a task, in their order."""
    planner = _planner(task.spec)
    return [_solved(planner, task, down) for down in task.downs]


def _planner(spec: Spec) -> "Planner":
    """Return a planner for a spec; this process keeps the planner until it needs one for another spec."""
    from heronry_manager.planner.exact import Planner  # noqa: PLC0415 - verifying alone needs no solver

    if not _warm or _warm[0].spec != spec:
        _warm[:] = [Planner(spec)]
    return _warm[0]


def _solved(planner: "Planner", task: Task, down: FaultSet) -> Outcome:
    now = Situation(down, {}, task.phase)
    found = planner.plan(now, task.running)
    violations = verify(task.spec, now, found.configuration)
    if violations:
        from heronry_manager.planner.deadlines import PlannerDefectError  # noqa: PLC0415 - as above

        lost = ", ".join(sorted(down)) or "nothing"
        raise PlannerDefectError(f"the plan that was made with {lost} down is not legal: {violations[0]}")
    return Outcome(found.configuration, found.objective, found.optimal)


def answers(spec: Spec, executor: Executor | None, questions: Sequence[Question]) -> Iterator[Answer]:
    """Answer all questions; yields each answer as soon as it is known, in no fixed order.

    executor: makes the plans; None: this process makes them. Raises UserError if a worker process has ended.
    """
    tasks = list(_tasks(spec, questions))
    if executor is None:
        for task in tasks:
            yield from zip(_questions(task), solved(task), strict=True)
        return
    try:
        with held_back():
            under_way = {executor.submit(solved, task): task for task in tasks}
        for done in as_completed(under_way):
            yield from zip(_questions(under_way[done]), done.result(), strict=True)
    except (BrokenExecutor, CancelledError) as error:
        raise UserError("a worker process has ended or was killed; repeat the command") from error


def _tasks(spec: Spec, questions: Iterable[Question]) -> Iterator[Task]:
    by_phase = sorted(
        questions, key=lambda question: question.phase or ""
    )  # a stable sort: the order within a phase stays
    for phase, alike in groupby(by_phase, key=lambda question: question.phase):
        of_phase = list(alike)
        for start in range(0, len(of_phase), _QUESTIONS_IN_A_TASK):
            part = of_phase[start : start + _QUESTIONS_IN_A_TASK]
            yield Task(spec, phase, part[0].running, tuple(question.down for question in part))


def _questions(task: Task) -> Iterator[Question]:
    return (Question(task.phase, down, task.running) for down in task.downs)


@contextmanager
def crew(jobs: int, scheduler: str | None = None) -> Iterator[Executor | None]:
    """Yield the executor that makes the plans; None: this process makes the plans itself.

    scheduler: the address of a Dask cluster that makes the plans.
    jobs: without a scheduler, the number of worker processes; with 1, None is yielded.
    Raises UserError if the cluster does not answer or has no workers.
    """
    if scheduler is not None:
        with _cluster(scheduler) as executor:
            yield executor
    elif jobs == 1:
        yield None
    else:
        with processes(jobs, _nothing, None) as executor:
            yield executor


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    from distributed import Client  # noqa: PLC0415 - an extra

    try:
        client = Client(address, timeout="5s")
    except (OSError, ValueError) as error:
        raise UserError(f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler") from error
    with client, client.get_executor() as executor:
        if not client.scheduler_info()["workers"]:
            raise UserError(f"the Dask scheduler at {address} has no workers; start some with: dask worker {address}")
        yield executor


def _nothing(_: None) -> None:
    """Do nothing when a worker process begins; the worker makes its planner for its first task."""
