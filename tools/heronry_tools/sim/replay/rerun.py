"""Replays one recorded mastership through the manager's core.

The core gets the frames that the manager heard, at their recorded times; between the frames the core is called at its
own deadlines. The bus does not show when the planner answered a request, nor with which plan. Both are derived from
what the manager prepared next:

- If the prepared digest is that of the best plan, of the greedy plan, or of a contingency, this plan is the answer. The
  answer was given at the time of the PREPARE.
- If the prepared configuration is another one, but legal in the situation of the core's request, the core gets this
  configuration, so that the replay can continue. A remark reports the difference, and the value of the recorded plan
  and of the best one.
- If the configuration prepared next is not legal in this situation, or none was prepared, there was no answer in time:
  the next request replaced this request, or the plan was no better than what ran.
- If a LEASE before any PREPARE names a configuration that could be the answer, the manager adopted this configuration.

If the whole bus is silent for longer than two heartbeat periods, nothing ran on the manager's computer, or the bus was
lost. After such a silence a manager first takes the frames that wait for it, and then handles its deadlines. So the
replay handles the deadlines of such a silence when the recorded manager sends again.

The operator's orders are not on the bus, so they are not replayed. The replay shows two kinds of decisions as decisions
that only the recording has: those that the manager took because of an order, and those that depend on them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.verify import verify
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.vocabulary import Emit, ManagerEvent, PlanReady, RequestPlan, Stop
from heronry_manager.events.by_kind import on
from heronry_manager.planner.exact import Planner
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planning_policy import (
    Answer,
    AskPlanner,
    Instruction,
    PlannerAnswered,
    PlanningPolicy,
    PrePlan,
    Source,
)
from heronry_tools.recording.commanded import Commanded
from heronry_tools.recording.masterships import Decision, RecordedMastership, decision_of, note
from heronry_tools.sim.world.planning import Prepared, prepared_with
from heronry_wire.frame import Malformed
from heronry_wire.management import decode_command
from heronry_wire.protocol_times import t_lease_ns
from heronry_wire.sansio import Received, Send, Tick

_TOLD: Mapping[type[events.Event], Callable[[Any], str]] = dict(
    [
        on(events.PeLost, lambda e: f"pe lost {e.pe}: {e.cause}"),
        on(events.PeAbsent, lambda e: f"pe absent {e.pe}: {e.cause}"),
        on(events.PeJoined, lambda e: f"pe joined {e.pe}: {e.cause}"),
        on(events.FaultReported, lambda e: f"fault reported {e.element}: {e.by}"),
        on(events.FaultCleared, lambda e: f"fault cleared {e.element}: {e.by}"),
        on(events.PhaseChanged, lambda e: f"phase changed {e.phase}: {e.by}"),
        on(events.PriorityChanged, lambda e: f"priority changed {e.function}: {e.by}"),
        on(events.Adopted, lambda e: f"adopted {e.epoch}"),
        on(events.EpochAbandoned, lambda e: f"epoch abandoned {e.epoch}: {e.reason}"),
        on(events.PeRefused, lambda e: f"pe refused {e.pe}: {e.reason}"),
        on(events.SecondManager, lambda e: f"second manager {e.node}"),
    ]
)
_EARLY_NS = 20_000_000  # a recorded PREPARE may precede its request in the replay by so much (clocks, loops)
_NAMES = {
    Source.CONTINGENCIES: "the contingency",
    Source.PLANNER: "the best plan",
    Source.IMMEDIATE: "the greedy plan",
    Source.SAFE_MODE: "the safe mode",
}


@dataclass(frozen=True, slots=True)
class Remark:
    """A sentence about a decision of the core: its reason, or a difference from the recording (`differs`)."""

    t_ns: int
    text: str
    differs: bool = False


@dataclass(frozen=True, slots=True)
class _Answer:
    at_ns: int
    ready: PlanReady
    remark: Remark


class Planners:
    """Makes the plans that a manager of a spec may have used, and names each by the digest of its configuration."""

    def __init__(self, spec: Spec, ahead: Prepared | None = None) -> None:
        """Begin with the planners of a spec; `ahead` has the contingencies, None if there are none."""
        self.spec, self.ahead = spec, ahead or prepared_with(spec, None)
        self._planner = Planner(spec)
        made = self.ahead.made
        with_plans = [] if made is None else [PlanningPolicy(spec, None, has_planner=True, contingencies=made)]
        with_solver = PlanningPolicy(spec, None, has_planner=True)
        without_solver = PlanningPolicy(spec, Greedy(spec), has_planner=False)
        self._fittings = (*with_plans, with_solver, without_solver)

    def digest(self, configuration: Configuration) -> int:
        """Return the digest by which PREPARE and LEASE name a configuration."""
        return self.ahead.compiler.configuration(configuration).digest

    def plans(self, request: RequestPlan) -> Iterator[tuple[str, Plan]]:
        """Yield the plans that could answer a request, one of each kind at most, each with the name of its kind.

        The kinds are the contingency, the best plan and the greedy plan; the likeliest plan comes first. The plans are
        those of planning policies with and without contingencies, and with and without a solver.
        """
        found = set()
        for policy in self._fittings:
            (instruction,) = policy.step(request)
            for answer in self._answers(policy, instruction):
                if isinstance(answer.answer, PlanReady) and answer.source not in found:
                    found.add(answer.source)
                    yield _NAMES[answer.source], answer.answer.plan

    def _answers(self, policy: PlanningPolicy, instruction: Instruction) -> Iterator[Answer]:
        """Yield the answers that follow from an instruction of a planning policy.

        If the policy requests a plan from the exact planner, this plan is made and given to the policy, and the answers
        of the policy to it are yielded.
        """
        match instruction:
            case Answer():
                yield instruction
            case AskPlanner(request):
                plan = self._planner.plan(request.now, request.running)
                for then in policy.step(PlannerAnswered(PlanReady(request.request, plan))):
                    yield from self._answers(policy, then)
            case PrePlan():  # pragma: no cover - requested only when nothing is under way
                return


class Rerun:
    """The replay of one mastership; `run` computes `decisions`, `remarks` and `events`."""

    def __init__(self, planners: Planners, mastership: RecordedMastership) -> None:
        self.decisions: list[Decision] = []
        self.remarks: list[Remark] = []
        self.events: list[events.Event] = []  # that the core told, and (`runs`) the plan of each epoch
        self._planners, self._mastership = planners, mastership
        spec = planners.spec
        self._recorded = _configurations(planners, mastership)
        self._answer: _Answer | None = None
        self._ended = False
        began_ns = mastership.first_ns - t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns)
        memory = Memory(term=mastership.term - 1)  # the core begins the next term, which is the recorded one
        self._standstills = _standstills(mastership, 2 * spec.buses[spec.manager.bus].heartbeat_ns)
        ahead = planners.ahead
        self._core = ManagerCore(
            spec, mastership.node, memory, began_ns, on_board=ahead.numbers, compiler=ahead.compiler
        )

    def run(self) -> None:
        """Replay the whole mastership."""
        for t_ns, frame in self._mastership.heard:
            self._until(t_ns)
            self._step(t_ns, Received(0, frame))
        self._until(self._mastership.last_ns)

    def _until(self, t_ns: int) -> None:
        """Call the core for all deadlines before `t_ns`, and with the planner's answers that come by `t_ns`.

        These calls are made in order of time.
        """
        while not self._ended:
            deadline_ns, answer = self._due_ns(self._core.next_deadline_ns()), self._answer
            if answer is not None and answer.at_ns <= t_ns and (deadline_ns is None or answer.at_ns <= deadline_ns):
                self._answer = None
                self.remarks.append(answer.remark)
                self._step(answer.at_ns, answer.ready)
            elif deadline_ns is not None and deadline_ns < t_ns:
                self._step(deadline_ns, Tick())
            else:
                return

    def _due_ns(self, deadline_ns: int | None) -> int | None:
        """Return when the manager handles a deadline; None if there is no deadline.

        This is the time of the deadline or, if the manager may have stood still then, the end of that standstill.
        """
        if deadline_ns is None:
            return None
        return next((end_ns for begin_ns, end_ns in self._standstills if begin_ns < deadline_ns < end_ns), deadline_ns)

    def _step(self, now_ns: int, event: ManagerEvent) -> None:
        if self._ended:
            return
        for action in self._core.step(now_ns, event):
            match action:
                case Send(frame=frame):
                    note(self.decisions, decision_of(self._mastership.node, now_ns, frame))
                case RequestPlan():
                    self._answer = self._find_answer(now_ns, action)
                case Emit(event=told):
                    self._tell(now_ns, told)
                    self._keep(told)
                case Stop():
                    self._ended = True

    def _tell(self, now_ns: int, told: events.Event) -> None:
        sentence = _TOLD.get(type(told))
        if sentence is not None:
            self.remarks.append(Remark(now_ns, sentence(told)))

    def _keep(self, told: events.Event) -> None:
        self.events.append(told)
        plan = self._core.plan
        if isinstance(told, events.Reconfigured | events.Adopted) and plan is not None:
            self.events.append(events.Runs(told.t_ns, told.epoch, plan.told()))

    def _find_answer(self, now_ns: int, request: RequestPlan) -> _Answer | None:
        """Derive from the recording what the planner answered, and when; return None if this cannot be derived.

        It cannot be derived in two cases:

        - After the request, the recorded manager neither adopted one of the replay's own plans nor sent a PREPARE.
        - The PREPARE after the request names none of these plans, but a configuration that is unknown, or illegal
          in the situation of the request.
        """
        likeliest_last = list(self._planners.plans(request))[::-1]
        known = {self._planners.digest(plan.configuration): (name, plan) for name, plan in likeliest_last}
        prepared = [d for d in self._mastership.decisions if d.what == "PREPARE" and d not in self.decisions]
        following = next((d for d in prepared if d.t_ns >= now_ns - _EARLY_NS), None)
        adopted = self._adopted(now_ns, following)
        if adopted in known:
            return _answer(now_ns, request, *known[adopted])
        if following is None:
            return None
        at_ns = max(now_ns, following.t_ns)
        if following.digest in known:
            return _answer(at_ns, request, *known[following.digest])
        recorded = self._as_plan(request, self._recorded.get(following.digest))
        return None if recorded is None else self._another(at_ns, request, recorded, known)

    def _adopted(self, now_ns: int, following: Decision | None) -> int | None:
        """Return the digest of the configuration that the manager adopted; None if it adopted none.

        An adopted configuration is named by a LEASE before any PREPARE of this mastership.

        following: the next decision, before which that LEASE must come; None: the LEASE may come up to the end.
        """
        if self.decisions:
            return None
        until_ns = self._mastership.last_ns if following is None else following.t_ns
        return next(
            (lease.digest for t_ns, lease in self._mastership.leases if now_ns <= t_ns < until_ns and lease.epoch), None
        )

    def _as_plan(self, request: RequestPlan, configuration: Configuration | None) -> Plan | None:
        now, spec = request.now, self._planners.spec
        if configuration is None or verify(spec, now, configuration):
            return None
        return make_plan(spec, now, configuration, score(spec, now, configuration, request.running), optimal=False)

    def _another(
        self, at_ns: int, request: RequestPlan, recorded: Plan, known: Mapping[int, tuple[str, Plan]]
    ) -> _Answer:
        best = max((plan for _, plan in known.values()), key=lambda plan: plan.objective.key())
        worth = "of equal value" if recorded.objective.key() == best.objective.key() else "of another value"
        ours, theirs = (plan.objective.key() for plan in (best, recorded))
        text = f"the recorded plan is legal but differs from the best one, {worth}: recorded {theirs}, best {ours}"
        return _Answer(at_ns, PlanReady(request.request, recorded), Remark(at_ns, text, differs=True))


def _answer(at_ns: int, request: RequestPlan, name: str, plan: Plan) -> _Answer:
    without = f" without {', '.join(sorted(request.now.down))}" if request.now.down else ""
    phase = f" in phase {request.now.phase}" if request.now.phase is not None else ""
    return _Answer(at_ns, PlanReady(request.request, plan), Remark(at_ns, f"{name}{without}{phase}"))


def _standstills(mastership: RecordedMastership, longest_ns: int) -> list[tuple[int, int]]:
    """Return the times (begin, end; ns) in which the manager may have stood still.

    Each time begins when the bus falls silent for more than `longest_ns`. It ends with the manager's next
    frame or, if no frame of the manager follows, with the end of the silence.
    """
    own = [t_ns for t_ns, _, _ in mastership.said]
    times = sorted([*own, *(t_ns for t_ns, _ in mastership.heard)])
    silences = [(begin_ns, end_ns) for begin_ns, end_ns in pairwise(times) if end_ns - begin_ns > longest_ns]
    return [(begin_ns, next((t_ns for t_ns in own if t_ns >= end_ns), end_ns)) for begin_ns, end_ns in silences]


def _configurations(planners: Planners, mastership: RecordedMastership) -> dict[int, Configuration]:
    """Return the configurations that were activated in a mastership, by digest."""
    commanded, found = Commanded(planners.spec, planners.ahead.tables.values()), {}
    for t_ns, command, frame in mastership.said:
        message = decode_command(command, frame.data)
        epoch = None if isinstance(message, Malformed) else commanded.take(t_ns, message)
        if epoch is not None and epoch.configuration is not None:
            found[epoch.digest] = epoch.configuration
    return found
