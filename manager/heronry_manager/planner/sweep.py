"""The best plan for every fault set up to a size, in several phases, with as little searching as can be.

Fault sets are gone through by size. Each takes the phase's fault-free plan as what runs (docs/semantics.md, faults). A
set is settled without a search

    by a plan    the best plan for the set less one element lives on: it is the best here, too (`heronry_dg.losses` has
                 the proof). What such a plan is worth is inherited with it, and so is a proof that is missing: what
                 bounds the worth with fewer faults bounds it with more.
    by a twin    another set leaves the planner exactly the same choice: the same PEs for each mode that may run and
                 has a purpose, and the same routes between them. A device and its only driver are the usual pair.

So a device on a dead PE, a PE behind a dead gateway and everything that a plan leaves idle cost nothing. Pruning is
exact in what plans are worth. Between plans worth the same at all seven levels it may choose another one than the
planner would.

`Sweep` does not plan by itself: `run` is given a function that answers questions, in any order, from a journal, in this
process or in many. What comes out does not depend on the order, because the questions of one size do not depend on
each other.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

from heronry_dg.configuration import Configuration
from heronry_dg.losses import lost_of, used_elements
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, placement
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_manager.planner.candidates import Candidates, candidates

Phase = str | None
FaultSet = frozenset[str]


@dataclass(frozen=True, slots=True)
class Scope:
    """What a sweep covers: all sets of up to `faults` of these elements, in these phases."""

    elements: tuple[str, ...]
    faults: int
    phases: tuple[Phase, ...]

    def fault_sets(self) -> Iterator[FaultSet]:
        """All sets: the smaller ones first, then in the order of the elements."""
        for size in self.sizes():
            yield from self.of_size(size)

    def sizes(self) -> range:
        """Sizes of the sets, from 0."""
        return range(min(self.faults, len(self.elements)) + 1)

    def of_size(self, size: int) -> Iterator[FaultSet]:
        """All sets of a size, in the order of the elements."""
        return map(frozenset, combinations(self.elements, size))

    def set_count(self) -> int:
        """How many sets there are, the empty one among them."""
        return sum(comb(len(self.elements), size) for size in self.sizes())


@dataclass(frozen=True, slots=True)
class Question:
    """Plan this: some elements down in a phase, while something runs (None: nothing is known to)."""

    phase: Phase
    down: FaultSet
    running: Placement | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """The answer: a configuration, its worth, and whether that is proven to be the best."""

    configuration: Configuration
    objective: Objective
    optimal: bool


Answer = tuple[Question, Outcome]
Ask = Callable[[int, list[Question]], Iterable[Answer]]
"""Answers questions about fault sets of a size, each once and in any order."""


@dataclass(slots=True)
class Tally:
    """How the fault sets of a sweep were settled."""

    searched: int = 0
    by_plan: int = 0
    by_twin: int = 0

    def pruned_share(self) -> float:
        """Share of all that needed no search."""
        total = self.searched + self.by_plan + self.by_twin
        return (self.by_plan + self.by_twin) / total if total else 0.0


class Sweep:
    """One sweep; `outcomes` and `tally` fill while it runs."""

    def __init__(self, spec: Spec, scope: Scope, *, prune: bool = True) -> None:
        """Prepare a sweep; without pruning every set is planned, as a check of the proof."""
        self.outcomes: dict[tuple[Phase, FaultSet], Outcome] = {}
        self.tally = Tally()
        self._spec, self._scope, self._prune = spec, scope, prune
        self._twins: dict[tuple[Phase, object], FaultSet] = {}
        self._used: dict[int, frozenset[str]] = {}  # by identity of an outcome, all of which are kept

    def run(self, ask: Ask) -> None:
        """Settle every fault set in every phase."""
        for size in self._scope.sizes():
            questions, twins = self._open(size)
            for question, outcome in ask(size, questions):
                self._settle(question.phase, question.down, outcome)
            for phase, down, twin in twins:
                self._settle(phase, down, self.outcomes[phase, twin])

    def running(self, phase: Phase) -> Placement | None:
        """What runs in a phase before faults come: its fault-free plan; None until that is known."""
        healthy = self.outcomes.get((phase, frozenset()))
        return None if healthy is None else placement(healthy.configuration)

    def _open(self, size: int) -> tuple[list[Question], list[tuple[Phase, FaultSet, FaultSet]]]:
        """Settle what can be; return the open questions, and the sets that share the answer of another set."""
        questions: list[Question] = []
        twins: list[tuple[Phase, FaultSet, FaultSet]] = []
        running = {phase: self.running(phase) for phase in self._scope.phases}
        for down in self._scope.of_size(size):
            left = survivors(self._spec, Situation(down))
            lost = lost_of(left)
            rest: object = None
            for phase in self._scope.phases:
                inherited = self._inherited(phase, down, lost) if self._prune else None
                if inherited is not None:
                    self.tally.by_plan += 1
                    self._settle(phase, down, inherited)
                    continue
                rest = rest or what_is_left(left)
                twin = self._twin(phase, down, rest) if self._prune else down
                if twin is down:
                    self.tally.searched += 1
                    questions.append(Question(phase, down, running[phase]))
                else:
                    self.tally.by_twin += 1
                    twins.append((phase, down, twin))
        return questions, twins

    def _twin(self, phase: Phase, down: FaultSet, rest: object) -> FaultSet:
        """Give the first set that leaves the same choice: the coarse comparison first, since it is cheap."""
        twin = self._twins.get((phase, rest))
        if twin is None:
            choice = choice_of(candidates(self._spec, Situation(down, {}, phase)))
            twin = self._twins[phase, rest] = self._twins.setdefault((phase, choice), down)
        return twin

    def _inherited(self, phase: Phase, down: FaultSet, lost: frozenset[str]) -> Outcome | None:
        """Outcome of a set with one fault less that lives on: the first one in the order of the elements."""
        for element in sorted(down):
            outcome = self.outcomes[phase, down - {element}]
            if self._used[id(outcome)].isdisjoint(lost):
                return outcome
        return None

    def _settle(self, phase: Phase, down: FaultSet, outcome: Outcome) -> None:
        self.outcomes[phase, down] = outcome
        if id(outcome) not in self._used:
            self._used[id(outcome)] = used_elements(self._spec, outcome.configuration)


def what_is_left(left: Survivors) -> object:
    """All that matters of what is left: with the same left, every phase has the same best plan."""
    return (
        tuple(left.hosts(module) for module in left.spec.modules.values()),
        tuple(left.pe_cpu_millis.items()),
        tuple(left.bus_mbit_per_s.items()),
        frozenset(left.routes.items()),
    )


def choice_of(possible: Candidates) -> object:
    """All that the best plan of a phase depends on, while nothing has shrunk: what may run where, and how it connects.

    PEs on which nothing may run, and routes to them, make no difference: no legal configuration uses them.
    """
    pes = {pe for candidate in possible.modules.values() for pe in candidate.pes()}
    return (
        tuple((name, tuple(candidate.hosts.items())) for name, candidate in possible.modules.items()),
        frozenset((ends, route) for ends, route in possible.left.routes.items() if pes.issuperset(ends)),
    )
