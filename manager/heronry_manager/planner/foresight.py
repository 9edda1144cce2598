"""Plans for what may happen next, made while nothing else is to do.

Once a configuration runs, a second planner's process (the *thinker*, which stands back behind everything else on the
computer) is asked, one question at a time, what the best plan would be if one more PE were lost, if one that is
lost came back, and if the next mission phase began. When just that happens, the answer is at hand and deciding takes no
time. The thinker is started with the first configuration; while it is down or slow, nothing is foreseen.

What was not foreseen gets the greedy plan, at once, after a look by the judge; the core asks for the best one when that
runs. The planner's own process is for what has time: the first configuration of a reign, which interrupts nothing, and
what is asked at leisure. It also stands in should the judge ever refuse a greedy plan.

Without a solver (`planner` is None) there are no processes at all: everything is answered by the greedy planner, which
needs no foresight. What is asked at leisure then gets the greedy plan of what runs, which may still be better.

A plan is known under all that it depends on: what is down or limited, the phase, and what runs. It was judged when it
was made, and these are its precondition; so nothing stale can be found here. When another configuration runs,
everything known is forgotten.

Faults of devices and modules, and pairs of faults, are not thought about here: they are in the contingency table
(`heronry_manager.contingency`), if there is one. It is looked into first, and what it knows is not thought about again.
"""

from collections import deque
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Protocol

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.vocabulary import Limits, PlanFailed, PlanReady, RequestPlan
from heronry_manager.planner.client import Failed, Planned
from heronry_manager.planner.greedy.planner import Greedy

_UNLIMITED: Limits = {}
_AHEAD = 0  # number of every question to the thinker: one is answered at a time

_Key = tuple[
    frozenset[str], frozenset[tuple[str, Fraction]], str | None, frozenset[tuple[str, tuple[str, str]]]
]  # down, limits, phase, running


class Asked(Protocol):
    """A planner that answers later: `heronry_manager.planner.client.PlannerClient`."""

    def request(self, number: int, now: Situation, running: Placement | None) -> None:
        """Ask for a plan."""

    def poll(self) -> list[Planned | Failed]:
        """Take what has been answered."""

    def fileno(self) -> int:
        """Descriptor that is readable when `poll` has something to do."""


class Foresight:
    """Asks a planner, and lets another one think ahead."""

    def __init__(
        self,
        spec: Spec,
        planner: Asked | None,
        start_thinker: Callable[[], Asked],
        table: ContingencyTable | None = None,
    ) -> None:
        """`planner`: None where there is no solver; then no thinker is started either."""
        self._spec, self._planner, self._start_thinker = spec, planner, start_thinker
        self._table, self._greedy = table, Greedy(spec)
        self._thinker: Asked | None = None
        self._known: dict[_Key, Plan] = {}
        self._questions: deque[_Key] = deque()
        self._thinking: _Key | None = None  # the question ahead that is being answered

    @property
    def is_thinking(self) -> bool:
        """Tell whether a question ahead is being answered."""
        return self._thinking is not None

    def readers(self) -> list[Asked]:
        """What an event loop watches: one of them is readable when `poll` has something to do."""
        return [one for one in (self._planner, self._thinker) if one is not None]

    def request(self, asked: RequestPlan) -> PlanReady | PlanFailed | None:
        """Ask for a plan; gives the answer if it is there at once, else it comes from `poll`."""
        plan = self._known.get(_key(asked.down, asked.limits, asked.phase, asked.running or {}))
        if plan is None and self._table is not None and not asked.limits:
            plan = self._table.plan(asked.down, asked.phase, asked.running)
        if plan is not None:
            return PlanReady(asked.request, plan)
        has_time = asked.at_leisure or asked.running is None
        if has_time and self._planner is not None:
            self._ask(self._planner, asked)
            return None
        return self._answer_at_once(asked)

    def _answer_at_once(self, asked: RequestPlan) -> PlanReady | PlanFailed | None:
        now = Situation(asked.down, asked.limits, asked.phase)
        plan = self._greedy.plan(now, asked.running)
        refusals = verify(self._spec, now, plan.configuration)
        if not refusals:
            return PlanReady(asked.request, plan)
        if self._planner is None:
            return PlanFailed(asked.request, f"the greedy plan is not legal: {refusals[0]}")
        self._ask(self._planner, asked)
        return None

    def _ask(self, planner: Asked, asked: RequestPlan) -> None:
        planner.request(asked.request, Situation(asked.down, asked.limits, asked.phase), asked.running)

    def poll(self) -> list[PlanReady | PlanFailed]:
        """Take what has been answered; the answers to questions ahead are kept."""
        if self._thinker is not None:
            for ahead in self._thinker.poll():
                self._keep(ahead)
        self._think()
        return [] if self._planner is None else [_told(answer) for answer in self._planner.poll()]

    def settled(self, down: frozenset[str], phase: str | None, running: Placement, limits: Limits = _UNLIMITED) -> None:
        """This configuration runs now, with these elements down or limited: think about what may come next."""
        if self._planner is None:
            return
        losses = [down | {f"pe:{pe}"} for pe in self._spec.pes if f"pe:{pe}" not in down]
        returns = [down - {element} for element in sorted(down) if element.startswith("pe:")]
        ahead = [_key(situation, limits, phase, running) for situation in (*losses, *returns)]
        ahead += [_key(down, limits, following, running) for following in self._phases_after(phase)]
        self._known = {key: plan for key, plan in self._known.items() if key in ahead}
        self._questions = deque(key for key in ahead if key not in self._known and not self._is_in_table(key))
        self._think()

    def _is_in_table(self, key: _Key) -> bool:
        down, limits, phase, running = key
        return self._table is not None and not limits and self._table.find(down, phase, dict(running)) is not None

    def _phases_after(self, phase: str | None) -> list[str]:
        """The phase that comes next in the spec's order, if one does."""
        order = list(self._spec.phases)
        return order[order.index(phase) + 1 :][:1] if phase is not None else []

    def _think(self) -> None:
        if self._thinking is not None or not self._questions:
            return
        if self._thinker is None:
            self._thinker = self._start_thinker()
        self._thinking = self._questions.popleft()
        down, limits, phase, running = self._thinking
        self._thinker.request(_AHEAD, Situation(down, dict(limits), phase), dict(running))

    def _keep(self, answer: Planned | Failed) -> None:
        key, self._thinking = self._thinking, None
        if key is not None and isinstance(answer, Planned):
            self._known[key] = answer.plan


def _key(down: frozenset[str], limits: Limits, phase: str | None, running: Mapping[str, tuple[str, str]]) -> _Key:
    return down, frozenset(limits.items()), phase, frozenset(running.items())


def _told(answer: Planned | Failed) -> PlanReady | PlanFailed:
    if isinstance(answer, Planned):
        return PlanReady(answer.request, answer.plan)
    return PlanFailed(answer.request, answer.reason)
