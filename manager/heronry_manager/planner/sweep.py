"""The sweep: the best plan for every fault set up to a size, in several phases, with as few searches as possible.

The sweep takes the smaller fault sets first. For each set, the phase's fault-free plan counts as the running one
(docs/semantics.md, faults). A set is settled without a search in two cases:

    by a plan    The set without one of its elements was settled before. If its plan uses nothing that the whole set
                 takes out of use, and no PE to which checkpoints are sent gets lost, this plan is also the best one for
                 the whole set (`heronry_dg.losses` has the proof). The whole set inherits the plan with its value. If
                 the plan is not proven to be the best, it is not proven for the whole set either. Its upper bounds
                 still hold, since such faults make no plan better
    by a twin    Another set leaves the planner exactly the same choice: the same PEs for each mode that may run and
                 has a purpose, and the same routes between these PEs. Then both sets have the same plan. The usual case
                 is a device and the only module that drives it

So no search is needed for a device on a dead PE, for a PE behind a dead gateway, and for all elements that a plan does
not use. To leave out searches never changes the value of a plan. If several plans have the same value at all seven
levels, the sweep may choose another of them than the planner would.

`Sweep` does not plan by itself. `run` gets a function that answers its questions; the answers may come from a journal,
from this process or from other processes. The questions of one size do not depend on each other, so their answers may
come in any order without an effect on the result.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

from heronry_dg.checkpoints import kept_modules
from heronry_dg.configuration import Configuration
from heronry_dg.losses import lost_of, receivers, used_elements
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, placement
from heronry_dg.situation import Situation, Survivors, places, survivors
from heronry_manager.planner.candidates import Candidates, candidates

Phase = str | None
FaultSet = frozenset[str]


@dataclass(frozen=True, slots=True)
class Scope:
    """The fault sets of a sweep: all sets of up to `faults` of the elements in `elements`, in each phase of `phases`.

    places: the sweep also plans for the failure of each place that a phase's fault-free plan uses, as a single fault.
        No effect if `faults` is 0.
    """

    elements: tuple[str, ...]
    faults: int
    phases: tuple[Phase, ...]
    places: bool = False

    def fault_sets(self) -> Iterator[FaultSet]:
        """Yield all fault sets, the smaller ones first, and those of one size in the order of the elements."""
        for size in self.sizes():
            yield from self.of_size(size)

    def sizes(self) -> range:
        """Return the possible sizes of a fault set: from 0 to `faults`, at most the number of elements."""
        return range(min(self.faults, len(self.elements)) + 1)

    def of_size(self, size: int) -> Iterator[FaultSet]:
        """Yield all fault sets with `size` elements, in the order of the elements."""
        return map(frozenset, combinations(self.elements, size))

    def set_count(self) -> int:
        """Return the number of fault sets in one phase, the empty set included."""
        return sum(comb(len(self.elements), size) for size in self.sizes())


@dataclass(frozen=True, slots=True)
class Question:
    """A request for a plan: the phase, the elements that are down, and what runs (None: not known)."""

    phase: Phase
    down: FaultSet
    running: Placement | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """The plan found for a fault set: its configuration, its value, and whether it is proven to be the best."""

    configuration: Configuration
    objective: Objective
    optimal: bool


Answer = tuple[Question, Outcome]
Ask = Callable[[int, list[Question]], Iterable[Answer]]
"""Answers questions about fault sets of a size, each once and in any order."""


@dataclass(slots=True)
class Tally:
    """How many questions of a sweep were settled in which way; a question is a fault set in one phase.

    searched: by a search of the planner.
    by_plan: by the plan for a fault set with one element less, which is still the best plan.
    by_twin: by the plan for another fault set, after which the planner has the same choice.
    """

    searched: int = 0
    by_plan: int = 0
    by_twin: int = 0

    def pruned_share(self) -> float:
        """Return the share of the questions that needed no search, from 0 to 1; 0 if there was no question."""
        total = self.searched + self.by_plan + self.by_twin
        return (self.by_plan + self.by_twin) / total if total else 0.0


class Sweep:
    """One sweep; `outcomes` and `tally` fill while it runs."""

    def __init__(self, spec: Spec, scope: Scope, *, prune: bool = True) -> None:
        """Prepare a sweep; if `prune` is False, every fault set takes a search, for tests of pruning."""
        self.outcomes: dict[tuple[Phase, FaultSet], Outcome] = {}
        self.tally = Tally()
        self._spec, self._scope, self._prune = spec, scope, prune
        self._twins: dict[tuple[Phase, object], FaultSet] = {}
        self._receivers = receivers(spec)  # the loss of one may make a plan better, as if each plan used it
        self._used: dict[int, frozenset[str]] = {}  # by `id` of an outcome; outcomes are kept, so it is unique

    def run(self, ask: Ask) -> None:
        """Find the plan for each fault set in each phase.

        Then, if `places` of the scope is set, find the plan for the loss of each place that a fault-free plan uses.

        ask: gives the plans that need a search.
        """
        for size in self._scope.sizes():
            questions, twins = self._open(size)
            for question, outcome in ask(size, questions):
                self._settle(question.phase, question.down, outcome)
            for phase, down, twin in twins:
                self._settle(phase, down, self.outcomes[phase, twin])
        in_use = self._places_in_use()
        for question, outcome in ask(1, in_use) if in_use else ():
            self._settle(question.phase, question.down, outcome)

    def _places_in_use(self) -> list[Question]:
        """List one question for each place that a fault-free plan uses: the plan to make when that place is lost."""
        if not self._scope.places or not self._scope.faults:
            return []
        found = [
            Question(phase, frozenset({place}), self.running(phase))
            for phase in self._scope.phases
            for place in places_in_use(self._spec, self.outcomes[phase, frozenset()].configuration)
        ]
        self.tally.searched += len(found)
        return found

    def running(self, phase: Phase) -> Placement | None:
        """Return the placement of the plan for a phase without faults; None: this plan is not known yet."""
        healthy = self.outcomes.get((phase, frozenset()))
        return None if healthy is None else placement(healthy.configuration)

    def _open(self, size: int) -> tuple[list[Question], list[tuple[Phase, FaultSet, FaultSet]]]:
        """Settle the sets of this size that inherit the plan of a smaller set.

        Return the questions about the sets that need a search, and (phase, set, twin) of each set that has a twin.
        The twin is an earlier set that leaves the planner the same choice.
        """
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
        """Return the first fault set that leaves the planner the same choice as `down`; that may be `down` itself.

        rest: the value of `what_is_left` for `down`. Fault sets with an equal `rest` leave the same choice. Only if no
        earlier set has an equal `rest`, the choices themselves are compared (`choice_of`), which takes longer.
        """
        twin = self._twins.get((phase, rest))
        if twin is None:
            choice = choice_of(candidates(self._spec, Situation(down, {}, phase)))
            twin = self._twins[phase, rest] = self._twins.setdefault((phase, choice), down)
        return twin

    def _inherited(self, phase: Phase, down: FaultSet, lost: frozenset[str]) -> Outcome | None:
        """Return a plan for `down` without one of its faults, if that plan uses no element of `lost`.

        The faults are left out in the order of their names; the first such plan is given. None: there is none.
        """
        for element in sorted(down):
            outcome = self.outcomes[phase, down - {element}]
            if self._used[id(outcome)].isdisjoint(lost):
                return outcome
        return None

    def _settle(self, phase: Phase, down: FaultSet, outcome: Outcome) -> None:
        self.outcomes[phase, down] = outcome
        if id(outcome) not in self._used:
            self._used[id(outcome)] = used_elements(self._spec, outcome.configuration) | self._receivers


def places_in_use(spec: Spec, configuration: Configuration) -> list[str]:
    """List the places that a configuration uses: each module that may run on several PEs, on the PE where it runs."""
    used = ((name, f"module:{name}@{running.pe}") for name, running in configuration.modules.items())
    return [place for name, place in used if place in places(spec, name)]


def what_is_left(left: Survivors) -> object:
    """Return all that plans can use after faults, as one value that can be compared.

    If two fault sets leave equal values, they have the same best plan in a phase.
    """
    return (
        tuple(left.hosts(module) for module in left.spec.modules.values()),
        tuple(left.pe_cpu_millis.items()),
        tuple(left.bus_mbit_per_s.items()),
        frozenset(left.routes.items()),
    )


def choice_of(possible: Candidates) -> object:
    """Return the choice that a fault set leaves, as one value: which modes may run on which PEs, and the routes.

    If no radio is limited, fault sets with equal values have the same best plan in a phase. PEs on which nothing may
    run, and routes to them, are left out, since no legal configuration uses them; but checkpoints are sent to them.
    """
    pes = {pe for candidate in possible.modules.values() for pe in candidate.pes()}
    return (
        tuple((name, tuple(candidate.hosts.items())) for name, candidate in possible.modules.items()),
        frozenset((ends, route) for ends, route in possible.left.routes.items() if pes.issuperset(ends)),
        tuple(possible.left.pe_cpu_millis) if any(kept_modules(possible.spec)) else (),
    )
