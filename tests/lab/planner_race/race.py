"""The race: planner, greedy planner and other solvers on the same faults, and their figures.

Each fault gives two comparisons. *Levels 1 and 2*: which contender serves the most critical functions and the highest
utility, with a proof, and in what time? *All levels*: how long does the whole plan take, and which levels are proven
within the effort? The figures are in two groups, by the load of the CPUs after the fault: the loss of a PE, or of a bus
with all PEs behind it, may overload an aircraft that was not overloaded before.

Time is CPU time of one core, from the request to the plan, including the building of the model; the planner has its
facts of the spec before, as in flight. Every result is scored by the same code; the verifier checks every plan.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, survivors
from heronry_dg.verify import verify
from heronry_manager.planner.exact import Planner
from lab.planner_race.generator import FaultCase, fault_cases, generate
from lab.planner_race.rivals import Highs, Solver, answered, cp_sat

CASES_PER_SPEC = 10
FULL = 1.05  # work up to which everything nearly fits, as a share of the CPU that is left
_CRITICAL = 4  # levels of the objective's key; utility comes next


@dataclass(frozen=True, slots=True)
class Size:
    """The size of the specs, and their work."""

    modules: int
    pes: int
    work: float

    def __str__(self) -> str:
        return f"{self.modules} x {self.pes}, work {self.work:g}"


@dataclass
class Entry:
    """One contender's results; all lists are by case."""

    name: str
    cpu_ms: list[float] = field(default_factory=list)
    served: list[tuple[int, ...]] = field(default_factory=list)  # critical A to D, utility
    proven: list[bool] = field(default_factory=list)

    def percentile(self, percent: int) -> float:
        """Return the CPU time in milliseconds that `percent` of the cases do not exceed; 0 without a case."""
        return percentile(self.cpu_ms, percent) if self.cpu_ms else 0.0

    def share_proven(self) -> float:
        """Return the share of the cases with a proof; 1 without a case."""
        return sum(self.proven) / len(self.proven) if self.proven else 1.0


@dataclass
class Race:
    """All results for one size."""

    size: Size
    serving: dict[str, Entry] = field(default_factory=dict)  # levels 1 and 2, by contender
    plans: Entry = field(default_factory=lambda: Entry(f"up to {FULL:g}"))  # all levels, by the work after the fault
    overloaded: Entry = field(default_factory=lambda: Entry(f"beyond {FULL:g}"))
    unproven: Counter[str] = field(default_factory=Counter)  # level -> plans in which it is not proven
    gaps: dict[str, list[float]] = field(default_factory=dict)  # level -> relative gaps, where there is one
    illegal: int = 0

    def disagreements(self) -> int:
        """Count cases in which two proofs contradict each other, or a result is better than a proof allows."""
        best = [max(served) for served in zip(*(entry.served for entry in self.serving.values()), strict=True)]
        return sum(
            proven and served != most
            for entry in self.serving.values()
            for proven, served, most in zip(entry.proven, entry.served, best, strict=True)
        )

    def greedy_utility(self) -> float:
        """Return the mean share of the planner's utility that the greedy planner reaches."""
        pairs = zip(self.serving["greedy"].served, self.serving["planner"].served, strict=True)
        shares = [ours[_CRITICAL] / best[_CRITICAL] for ours, best in pairs if best[_CRITICAL]]
        return sum(shares) / len(shares) if shares else 1.0

    def greedy_losses(self) -> int:
        """Count cases in which the greedy planner serves less of a critical class than the planner."""
        pairs = zip(self.serving["greedy"].served, self.serving["planner"].served, strict=True)
        return sum(ours[:_CRITICAL] < best[:_CRITICAL] for ours, best in pairs)


def percentile(values: Sequence[float], percent: int) -> float:
    """Return the smallest value that `percent` of the values do not exceed."""
    return sorted(values)[max(0, -(-len(values) * percent // 100) - 1)]


def run(
    size: Size, cases: int, seed: int, *, effort: float, rivals: Sequence[str], progress: Callable[[int], None]
) -> Race:
    """Race on `cases` faults, ten for each spec; calls `progress` with the number of cases that are done."""
    race = Race(size)
    with ExitStack() as stack:
        solvers: dict[str, Solver] = {}
        if "cp-sat" in rivals:
            solvers["cp-sat"] = cp_sat
        if "highs" in rivals:
            solvers["highs"] = stack.enter_context(Highs())
        for done, (spec, planner, case) in enumerate(_questions(size, cases, seed)):
            progress(done)
            _serve(race, spec, planner, case, solvers)
            _plan(race, spec, planner, case, effort)
    return race


def _questions(size: Size, cases: int, seed: int) -> Iterator[tuple[Spec, Planner, FaultCase]]:
    for first in range(0, cases, CASES_PER_SPEC):
        number = seed + first // CASES_PER_SPEC
        spec = generate(number, size.modules, size.pes, size.work)
        planner = Planner(spec)
        for case in fault_cases(spec, number, min(CASES_PER_SPEC, cases - first)):
            yield spec, planner, case


def work_after(spec: Spec, now: Situation) -> float:
    """Return the CPU of every module in its best mode, as a share of the CPU that a fault leaves."""
    left = sum(survivors(spec, now).pe_cpu_millis.values())
    wanted = sum(next(iter(module.modes.values())).cpu_millis for module in spec.modules.values())
    return wanted / left if left else float("inf")


def _serve(race: Race, spec: Spec, planner: Planner, case: FaultCase, solvers: dict[str, Solver]) -> None:
    """Compare planner, greedy planner and solvers on levels 1 and 2."""
    start = time.process_time()
    greedy = planner.immediate(case.now, case.running)
    _note(race, "greedy", time.process_time() - start, greedy.objective.key(), proven=False)
    start = time.process_time()
    served = planner.serve(case.now, case.running)
    _note(race, "planner", time.process_time() - start, served.objective.key(), proven=served.proven)
    times = ResponseTimes(spec)
    for name, solver in solvers.items():
        answer = answered(solver, times, case.now)
        key = score(spec, case.now, answer.configuration, None).key()
        _note(race, name, answer.cpu_seconds, key, proven=answer.proven)
        race.illegal += not _is_legal_but_for_idle_modules(spec, case.now, answer.configuration)


def _is_legal_but_for_idle_modules(spec: Spec, now: Situation, configuration: Configuration) -> bool:
    return all(violation.rule == "5.idle" for violation in verify(spec, now, configuration))


def _note(race: Race, name: str, seconds: float, key: tuple[int, ...], *, proven: bool) -> None:
    entry = race.serving.setdefault(name, Entry(name))
    entry.cpu_ms.append(1000 * seconds)
    entry.served.append(key[: _CRITICAL + 1])
    entry.proven.append(proven)


def _plan(race: Race, spec: Spec, planner: Planner, case: FaultCase, effort: float) -> None:
    """Measure the planner on all levels."""
    entry = race.plans if work_after(spec, case.now) <= FULL else race.overloaded
    start = time.process_time()
    plan = planner.plan(case.now, case.running, effort=effort)
    entry.cpu_ms.append(1000 * (time.process_time() - start))
    entry.proven.append(plan.optimal)
    race.illegal += bool(verify(spec, case.now, plan.configuration))
    for level in plan.levels:
        if not level.proven and level.bound is not None:
            race.unproven[level.level] += 1
            gap = abs(level.bound - level.value) / max(abs(level.bound), abs(level.value), 1)
            race.gaps.setdefault(level.level, []).append(gap)
