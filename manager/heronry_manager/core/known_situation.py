"""The situation as the manager knows it: what is down, what has shrunk, and the phase.

Whatever changes it gives back what follows, as values, in the order in which that is to be done (`reactions`):

    HealthChange      a PE is counted on no more: it was latched, or its radio is gone
    PlanNeeded        what runs was planned for another situation
    LimitChanged      a radio has another limit: what runs may be as good as any under it
    ModuleReleased    a module is taken for well again that its PE has stopped: only another epoch starts it

Down is what is latched (`latched_faults`), and every PE that is not counted on (`health`). What a radio has left is
`radio_links`'s to say, and the phase is `mission_phase`'s; `lost_channels` and `restarts_told` are told of, and are no
part of a plan. What a lost, late, doubled or forged message does to any of them is written there.

A PE that is latched is barred: it may speak as well as it likes, nobody counts on it until it is cleared.

That the manager's own bus has failed is no part of a plan, whoever says so: it was heard there, and a plan for it would
stop everything that flies.

Who stands by hears what is latched in turn (`announcing`), and what is cleared once. What it has not been told again
for three turns is latched no more: a CLEAR that was lost costs some beats. So does who advises beside it, but for what
the operator has told this manager himself: that he only supposes, and it stays until somebody says something new of it.

All of it outlives a restart (`memory`), and so does a quarantine: who is held down for long goes on waiting.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, survivors
from heronry_manager.core.health import Health, HealthChange
from heronry_manager.core.latched_faults import HELD_CODE, OPERATOR_CODE, LatchedFault, LatchedFaults
from heronry_manager.core.lost_channels import LostChannels
from heronry_manager.core.memory import Asked, Cleared, Latched, PhaseEntered, Released
from heronry_manager.core.mission_phase import MissionPhase
from heronry_manager.core.radio_links import RadioLinks
from heronry_manager.core.restarts_told import RestartsTold
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame
from heronry_wire.management import FORWARD_ONLY, Control, ElementKind, Emergency, FaultCode, Operation
from heronry_wire.protocol_times import ANNOUNCED_EVERY, t_lease_ns

"""Beats from one thing that the manager who reigns tells in turn to the next."""

_KINDS = frozenset(ElementKind)
_TURNS = 3  # in which something that is latched may stay untold


@dataclass(frozen=True, slots=True)
class PlanNeeded:
    """The situation is another one, for this cause.

    since_ns: the last sign of the old situation, where it is older than this moment.
    """

    cause: str
    since_ns: int | None = None


@dataclass(frozen=True, slots=True)
class LimitChanged:
    """A radio carries more or less than it did."""

    cause: str


@dataclass(frozen=True, slots=True)
class ModuleReleased:
    """A module counts as well again, and does not run before an epoch starts it."""

    module: str


SituationChange = HealthChange | PlanNeeded | LimitChanged | ModuleReleased
Changes = Sequence[SituationChange]


class KnownSituation:
    """What is down, and the phase."""

    def __init__(self, spec: Spec, turn: Turn, health: Health) -> None:
        """Know what is remembered, and nothing else."""
        self._spec, self._turn, self._health = spec, turn, health
        self._mission = MissionPhase(spec)
        self._lease_ns = t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns)  # for which a frame may wait
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self.failed = LatchedFaults(spec)
        self.links = RadioLinks(spec)
        self.channels = LostChannels(spec, turn)
        self._restarts = RestartsTold(spec, turn)
        self.own_bus = f"bus:{spec.manager.bus}"
        self._untold: Counter[str] = Counter()  # beats since another manager has said that it holds an element
        self._told_phase: int | None = None  # by another manager, last
        self._has_just_told_phase = False  # with nothing after it but which requests have been obeyed
        self._remember()

    @property
    def phase(self) -> str | None:
        """Mission phase that plans are made for; None where the spec has none."""
        return self._mission.current

    def now(self) -> Situation:
        """What plans are made for."""
        return Situation(self.down(), self.links.limits(), self.phase)

    def spares(self, plan: Plan) -> bool:
        """Tell whether a plan for other limits is legal under these, and none has risen: it is as good as any."""
        limits = self.links.limits()
        room = survivors(self._spec, Situation(frozenset(), limits)).bus_mbit_per_s
        fits = all(1000 * (used.bits_per_s + 1) <= room[bus] for bus, used in plan.buses.items())
        return fits and all(limits.get(element, 1) <= share for element, share in plan.now.limits.items())

    def link_reported(self, frame: Frame) -> Changes:
        """A gateway says how a radio is doing."""
        changes: list[SituationChange] = []
        beyond = self.links.records[frame.can_id].radio.beyond
        anybody = any(self._health.is_available(pe) for pe in beyond)
        for change in self.links.heard(frame, self._turn.now_ns, anybody_beyond=anybody):
            radio = change.radio
            cause = f"bus:{radio.bus} is {change.what}, says {radio.gateway}"
            match change.what:
                case "gone":
                    self._turn.emit("link_gone", bus=radio.bus, by=radio.gateway)
                    changes += self._health.cut_off(sorted(radio.beyond), cause, self._turn.now_ns)
                case "back":
                    self._turn.emit("link_back", bus=radio.bus, by=radio.gateway)
                case _:
                    share = f"{change.step / 10:g}%"
                    self._turn.emit("link_limited", bus=radio.bus, by=radio.gateway, share=share)
                    changes.append(LimitChanged(f"bus:{radio.bus} has {share} of its bandwidth, says {radio.gateway}"))
        return changes

    def _remember(self) -> None:
        """Take up what was known before a restart."""
        memory, now_ns = self._turn.memory, self._turn.now_ns
        self._mission.current = memory.phase or self._mission.current
        self._mission.remember({pe: (one.incarnation, one.number) for pe, one in memory.asked.items()})
        for one in memory.latched.values():
            self.failed.latch(LatchedFault(one.element, one.by, one.code, one.detail, now_ns))
            kind, _, name = one.element.partition(":")
            if kind == "pe":
                self._health.bar(name, f"failed, reported by {one.by}", now_ns)
        for pe, losses in memory.quarantined.items():
            self._health.quarantine(pe, losses)

    def down(self) -> frozenset[str]:
        """Everything that is down, as `kind:name`."""
        missing = (f"pe:{pe}" for pe in self._spec.pes if not self._health.is_available(pe))
        return (self.failed.elements | frozenset(missing)) - {self.own_bus}

    def reported(self, pe: str, emergency: Emergency) -> Changes | None:
        """A PE reports a fault; gives what follows, or None where that was not understood."""
        element = self.failed.element(emergency.kind, emergency.index)
        if element is None:
            return None
        if emergency.code is FaultCode.MODULE_RESTARTED:
            self._restarts.reported(pe, element, emergency.detail)
            return ()
        return self.latch(LatchedFault(element, pe, emergency.code.name, emergency.detail, self._turn.now_ns))

    def requested(self, pe: str, request: Emergency) -> Changes | None:
        """A PE asks for a phase; gives what follows, or None where that was not heard."""
        incarnation = self._health.incarnation(pe) if self._health.is_available(pe) else None
        if incarnation is None or not self._mission.knows(request.index):
            return None
        is_new = self._request_accepted(pe, incarnation, request.detail)
        if is_new and self._mission.allows(request.index, request.detail):
            return self.enter(list(self._spec.phases)[request.index], pe)
        return ()

    def _request_answered(self, pe: str, detail: int) -> None:
        """Another manager has said, perhaps a moment ago, that it has obeyed a request of the incarnation of then."""
        incarnation = self._health.said_incarnation(pe, self._turn.now_ns - self._lease_ns)
        if incarnation is not None:
            self._request_accepted(pe, incarnation, detail)

    def _request_accepted(self, pe: str, incarnation: int, detail: int) -> bool:
        """A request of a PE is obeyed, here or elsewhere; tells whether that is news."""
        if not self._mission.accepted(pe, incarnation, detail):
            return False
        self._turn.keep(Asked(pe, incarnation, detail & ~FORWARD_ONLY))
        return True

    def overheard(self, manager: int, told: Control) -> Changes:
        """Another manager is active, and has said what it holds, what is cleared, or which request it has obeyed."""
        if told.operation is Operation.ACKNOWLEDGE and told.a == ElementKind.PHASE:
            if told.node in self._pe_of_node and self._has_just_told_phase:
                self._request_answered(self._pe_of_node[told.node], told.b)
            return ()
        self._has_just_told_phase = told.operation is Operation.HOLDS and told.a == ElementKind.PHASE
        if self._has_just_told_phase:
            return self._phase_told(manager, told.b)
        kind = ElementKind(told.a) if told.a in _KINDS else None
        element = None if kind is None else self.failed.element(kind, told.b)
        if element is not None and told.operation is Operation.HOLDS:
            self._untold[element] = 0
            return self.latch(LatchedFault(element, f"manager {manager}", HELD_CODE, 0, self._turn.now_ns))
        if element is not None and told.operation is Operation.CLEAR:
            return self.clear(element, f"manager {manager}") or ()
        return ()

    def _phase_told(self, manager: int, index: int) -> Changes:
        if not self._mission.knows(index) or index == self._told_phase:
            return ()
        self._told_phase, phase = index, list(self._spec.phases)[index]
        return () if phase == self.phase else self.enter(phase, f"manager {manager}")

    def held_no_longer(self) -> list[str]:
        """Another manager is active, and has told a fact if one was due: gives what it does not hold any more."""
        supposed = {one.element for one in self.failed.all() if self._turn.silent and one.code == OPERATOR_CODE}
        elements = self.failed.elements - supposed
        self._untold = Counter({element: self._untold[element] + 1 for element in elements})
        longest = _TURNS * ANNOUNCED_EVERY * (1 + len(elements))  # the phase has its turn, too
        return [element for element in sorted(elements) if self._untold[element] > longest]

    def latch(self, fault: LatchedFault) -> Changes:
        """An element has failed, as somebody says."""
        is_news = fault.element not in self.failed.elements
        if self.failed.latch(fault):
            self._turn.keep(Latched(fault.element, fault.by, fault.code, fault.detail))
        if not is_news:
            return ()
        self._turn.emit("fault_reported", element=fault.element, by=fault.by, detail=fault.detail, code=fault.code)
        kind, _, name = fault.element.partition(":")
        changes: list[SituationChange] = []
        if kind == "pe":
            changes += self._health.bar(name, f"failed, reported by {fault.by}", self._turn.now_ns)
        if not changes:  # else what follows from the loss of the PE is that
            changes.append(PlanNeeded(f"{fault.element} failed, reported by {fault.by}"))
        return changes

    def clear(self, element: str, by: str) -> Changes | None:
        """An element is taken for well again; gives what follows, or None where nothing was held against it."""
        fault = self.failed.clear(element)
        kind, _, name = element.partition(":")
        let_in = kind == "pe" and self._health.forgive(name)
        if fault is None and not let_in:
            return None
        changes: list[SituationChange] = []
        if fault is not None:
            self._turn.keep(Cleared(element))
            if kind == "module" and fault.code != OPERATOR_CODE:
                changes.append(ModuleReleased(name))
        if name in self._turn.memory.quarantined and let_in:
            self._turn.keep(Released(name))
        self._turn.emit("fault_cleared", element=element, by=by)
        if kind != "pe":  # a PE is planned with when it has joined
            changes.append(PlanNeeded(f"{element} cleared by {by}"))
        return changes

    def enter(self, phase: str, by: str) -> Changes:
        """Somebody wants another mission phase."""
        before, self._mission.current = self._mission.current, phase
        self._turn.keep(PhaseEntered(phase))
        self._turn.emit("phase_changed", phase=phase, before=before, by=by)
        return (PlanNeeded(f"phase {phase}, asked for by {by}"),)
