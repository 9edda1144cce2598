"""The situation as the manager knows it: what is down, what is limited, the phase, and changed priorities.

A method that changes the situation returns the consequences (`changes`). The caller hands them to `reactions`, in their
order.

All elements with a latched fault (`latched_faults`), and all PEs that are not available (`health`), are down.
`radio_links` gives the remaining bandwidth of each radio, `mission_phase` the phase and `changed_priorities` the
priorities. `lost_channels`, `module_notices` and `restarts_told` only make reports, and change no plan. The head of
each of these files says what follows from a lost, late, doubled or forged message.

A PE with a latched fault is barred: whatever it sends, it is not available until the fault is cleared.

A report that the manager's own bus has failed changes no plan: the report was heard on that bus, and a plan without
that bus would stop everything in flight.

The active manager announces all latched faults repeatedly, one after the other (`announcing`). It sends each CLEAR only
once. A standby manager drops a fault that was missing in three rounds of these announcements. So if a CLEAR is lost,
the standby manager drops the fault some heartbeat periods later.

A manager may also only advise the operator, while another manager is active. It follows the announcements in the same
way, with one exception: a fault that the operator has reported to this manager itself. Such a fault is an assumption,
and stays until another report on the element comes.

The whole situation survives a restart (`memory`), and so does a quarantine.
"""

from collections import Counter

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, survivors
from heronry_manager import events
from heronry_manager.core.membership import Health
from heronry_manager.core.memory import Cleared, Latched, PhaseEntered, PhaseRequest, PriorityRequest, Released
from heronry_manager.core.situation.changed_priorities import ChangedPriorities, Fact
from heronry_manager.core.situation.changes import (
    Changes,
    LimitChanged,
    ModuleReleased,
    PeSuspected,
    PlanNeeded,
    SituationChange,
)
from heronry_manager.core.situation.checkpoint_notices import CheckpointNotices
from heronry_manager.core.situation.latched_faults import (
    HELD_CODE,
    LACK_CODE,
    OPERATOR_CODE,
    LatchedFault,
    LatchedFaults,
)
from heronry_manager.core.situation.lost_channels import LostChannels
from heronry_manager.core.situation.mission_phase import MissionPhase
from heronry_manager.core.situation.module_notices import (
    Disagreements,
    ModuleNotices,
    UnknownInputs,
    UnknownOutputs,
    UnknownReports,
)
from heronry_manager.core.situation.radio_links import RadioLinks
from heronry_manager.core.situation.restarts_told import RestartsTold
from heronry_manager.core.situation.suspicions import Suspicions
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame
from heronry_wire.management import FORWARD_ONLY, Control, ElementKind, Emergency, FaultCode, Operation
from heronry_wire.protocol_times import ANNOUNCED_EVERY, t_lease_ns

_TURNS = 3  # of announcements, in which a latched fault may stay unannounced


class KnownSituation:
    """Keeps what is down, what is limited, the phase, and changed priorities."""

    def __init__(self, spec: Spec, turn: Turn, health: Health) -> None:
        """Begin with what is remembered over a restart, and nothing else."""
        self._spec, self._turn, self._health = spec, turn, health
        self._lease_ns = t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns)  # the longest wait of a frame
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self.own_bus = f"bus:{spec.manager.bus}"
        self.forget()

    def forget(self) -> None:
        """Forget everything but what is remembered over a restart."""
        spec, turn, health = self._spec, self._turn, self._health
        self._mission = MissionPhase(spec)
        self.failed = LatchedFaults(spec)
        self._lacking: dict[str, LatchedFault] = {}  # by element: the last report that code is missing
        self.links = RadioLinks(spec)
        self.priorities = ChangedPriorities(spec, turn)
        self.channels = LostChannels(spec, turn)
        self.disagreements = Disagreements(spec, turn)
        self.checkpoints = CheckpointNotices(spec, turn)
        self._notices: dict[FaultCode, ModuleNotices] = {
            FaultCode.DISAGREEMENT: self.disagreements,
            FaultCode.STATE_RESTORED: self.checkpoints,
            FaultCode.STATE_LACKING: self.checkpoints,
            FaultCode.UNKNOWN_ELEMENT: UnknownReports(spec, turn),
            FaultCode.UNKNOWN_OUTPUT: UnknownOutputs(spec, turn),
            FaultCode.UNKNOWN_INPUT: UnknownInputs(spec, turn),
        }
        self._suspicions = Suspicions(spec, turn, health)
        self._restarts = RestartsTold(spec, turn)
        self._untold: Counter[str] = Counter()  # beats since another manager announced that it holds an element
        self._told_phase: int | None = None  # the phase that another manager announced last
        self._has_just_told_phase = False  # it has announced a phase, and since then only acknowledged requests
        self._remember()

    @property
    def phase(self) -> str | None:
        """The mission phase for which plans are made; None: the spec has no phases."""
        return self._mission.current

    def now(self) -> Situation:
        """Return the situation that plans are made for."""
        return Situation(self.down(), self.links.limits(), self.phase, self.priorities.now())

    def spares(self, plan: Plan) -> bool:
        """Tell whether a plan need not be replaced although limits of radios have changed.

        This is so if the plan fits the present limits, and none of the limits for which it was made has risen.
        """
        limits = self.links.limits()
        room = survivors(self._spec, Situation(frozenset(), limits)).bus_mbit_per_s
        fits = all(1000 * (used.bits_per_s + 1) <= room[bus] for bus, used in plan.buses.items())
        return fits and all(limits.get(element, 1) <= share for element, share in plan.now.limits.items())

    def is_failed(self, element: str) -> bool:
        """Tell whether a fault is latched on an element."""
        return element in self.failed.elements

    def only_lacks(self, element: str) -> bool:
        """Tell whether nothing but a lack of code is latched on an element."""
        return self.failed.code(element) == LACK_CODE

    def element(self, emergency: Emergency) -> str | None:
        """Return the element that an EMCY names; None: the spec lacks it."""
        return self.failed.element(emergency.kind, emergency.index)

    def field(self, element: str) -> tuple[int, int] | None:
        """Return the fields a and b of CONTROL that name an element; None: no command can name it."""
        return self.failed.field(element)

    def facts(self) -> list[Fact]:
        """List the latched faults and changed priorities, as the active manager announces them."""
        fields = map(self.failed.field, self.failed.elements)
        held = sorted(field for field in fields if field is not None)
        return [(Operation.HOLDS, *field) for field in held] + self.priorities.facts()

    def fact_count(self) -> int:
        """Return the number of latched faults and changed priorities: so many announcements make a round."""
        return len(self.failed.elements) + len(self.priorities.facts())

    def beat(self) -> None:
        """Note that a heartbeat period has passed: notices and suspicions end that nobody repeats."""
        self.channels.beat()
        for notices in self._notices.values():
            notices.beat()
        self._suspicions.beat()

    # What PEs and gateways report

    def answered(self, pe: str) -> None:
        """Note that a state of a PE has come, which may answer a suspicion."""
        self._suspicions.answered(pe)

    def noticed(self, pe: str, emergency: Emergency) -> bool:
        """Take a notice of a module (`module_notices`), which changes no plan; False: the EMCY is no notice."""
        notices = self._notices.get(emergency.code)
        if notices is not None:
            notices.reported(pe, emergency)
        return notices is not None

    def channel_reported(self, pe: str, emergency: Emergency) -> None:
        """Note a PE's report that a channel of a replicated bus carries nothing, or carries frames again."""
        self.channels.reported(pe, emergency)

    def own_channels_lost(self, channels: frozenset[int]) -> None:
        """Note the channels of the manager's bus on which this manager hears nothing."""
        self.channels.own(channels)

    def is_of_a_radio(self, identifier: int) -> bool:
        """Tell whether a gateway reports on a radio under this CAN identifier."""
        return identifier in self.links.records

    def gateway_lost(self, pe: str) -> None:
        """Note that a PE is no longer available: if it is a gateway, its reports count anew when it is back."""
        self.links.restarted(pe)

    def link_reported(self, frame: Frame) -> Changes:
        """Note a gateway's report on its radio; gives the changes that follow."""
        changes: list[SituationChange] = []
        beyond = self.links.records[frame.can_id].radio.beyond
        anybody = any(self._health.is_available(pe) for pe in beyond)
        for change in self.links.heard(frame, self._turn.now_ns, any_pe_beyond=anybody):
            radio = change.radio
            cause = f"bus:{radio.bus} is {change.what}, reported by {radio.gateway}"
            match change.what:
                case "gone":
                    self._turn.emit(events.LinkGone, bus=radio.bus, by=radio.gateway)
                    changes += self._health.cut_off(sorted(radio.beyond), cause, self._turn.now_ns)
                case "back":
                    self._turn.emit(events.LinkBack, bus=radio.bus, by=radio.gateway)
                case _:
                    share = f"{change.step / 10:g}%"
                    self._turn.emit(events.LinkLimited, bus=radio.bus, by=radio.gateway, share=share)
                    changes.append(
                        LimitChanged(f"bus:{radio.bus} has {share} of its bandwidth, reported by {radio.gateway}")
                    )
        return changes

    def _remember(self) -> None:
        """Restore from the memory what this manager knew before its restart.

        This is the phase, the executed phase requests, the latched faults, and the losses of PEs in quarantine.
        """
        memory, now_ns = self._turn.memory, self._turn.now_ns
        self._mission.current = memory.phase or self._mission.current
        self._mission.remember({pe: (one.incarnation, one.number) for pe, one in memory.phase_requests.items()})
        for one in memory.latched.values():
            self.failed.latch(LatchedFault(one.element, one.by, one.code, one.detail, now_ns))
            kind, _, name = one.element.partition(":")
            if kind == "pe":
                self._health.bar(name, f"failed, reported by {one.by}", now_ns)
        for pe, losses in memory.quarantined.items():
            self._health.quarantine(pe, losses)

    def down(self) -> frozenset[str]:
        """Return the elements that are down, each as `kind:name`.

        The manager's own bus is left out, since a plan without this bus would stop everything.
        """
        missing = (f"pe:{pe}" for pe in self._spec.pes if not self._health.is_available(pe))
        return (self.failed.elements | frozenset(missing)) - {self.own_bus}

    def reported(self, pe: str, emergency: Emergency) -> Changes | None:
        """Take the fault that a PE reports.

        A fault of a device or module is latched. A fault of a PE or bus is only a suspicion (`suspicions`).
        A restart of a module is only reported as an event.

        Gives the changes that follow; None if the report names an element that the spec lacks.
        """
        element = self.failed.element(emergency.kind, emergency.index)
        if element is None:
            return None
        if emergency.code is FaultCode.MODULE_RESTARTED:
            self._restarts.reported(pe, element, emergency.detail)
            return ()
        kind, _, name = element.partition(":")
        if kind == "pe":
            return (PeSuspected(name),) if self._suspicions.pe(name, pe) else ()
        if kind == "bus":
            self._suspicions.bus(name, pe)
            return ()
        return self.failed_there(element, pe, emergency)

    def failed_there(self, element: str, pe: str, emergency: Emergency) -> Changes:
        """Latch a fault that a PE reports of an element, or of a module's place on this PE; gives the changes."""
        element = self.failed.where(element, pe, emergency.code)
        fault = LatchedFault(element, pe, emergency.code.name, emergency.detail, self._turn.now_ns)
        if fault.code == LACK_CODE:
            self._lacking[element] = fault
        return self.latch(fault)

    def code_arrived(self, element: str, by: str) -> Changes | None:
        """End the lack of code of an element; gives the changes that follow.

        None: the element stays down, since another fault or an order stands.
        """
        self._lacking.pop(element, None)
        return self.clear(element, by) if self.failed.code(element) in (LACK_CODE, HELD_CODE) else None

    def lacking_code(self) -> list[LatchedFault]:
        """Return what PEs have reported of missing code, for elements that count as failed, for whatever reason."""
        return [fault for element, fault in self._lacking.items() if self.failed.code(element) is not None]

    def requested(self, pe: str, request: Emergency) -> Changes | None:
        """Decide on a request for a phase or a priority.

        Gives the changes that follow; None if the request must not be acknowledged.
        """
        incarnation = self._health.incarnation(pe) if self._health.is_available(pe) else None
        if incarnation is not None and request.kind is ElementKind.PRIORITY:
            causes = self.priorities.requested(pe, incarnation, request)
            return None if causes is None else tuple(map(PlanNeeded, causes))
        if incarnation is None or not self._mission.knows(request.index):
            return None
        is_new = self._request_accepted(pe, incarnation, request.detail)
        if is_new and self._mission.allows(request.index, request.detail):
            return self.enter(list(self._spec.phases)[request.index], pe)
        return ()

    # Priorities

    def can_change_priority(self, function: str) -> bool:
        """Tell whether commands can name this function, so that its priority can be changed."""
        return self.priorities.can_change(function)

    def priority_fact(self, function: str) -> Fact:
        """Return the priority of a function as a fact to announce."""
        return self.priorities.told(self.priorities.index_of(function))

    def priority_fact_at(self, index: int) -> Fact:
        """Return the priority of the function with this index as a fact to announce."""
        return self.priorities.told(index)

    def accepted_requests(self, index: int) -> list[PriorityRequest]:
        """List the executed requests for the priority of the function with this index."""
        return self.priorities.accepted(index)

    def order_priority(self, function: str, priority: int | None) -> Changes:
        """Set a function's priority by an order of the operator (None: the spec's priority).

        Gives the changes that follow.
        """
        cause = self.priorities.order(function, priority)
        return () if cause is None else (PlanNeeded(cause),)

    def _request_answered(self, pe: str, kind: int, number: int) -> None:
        """Note that another manager has acknowledged a request of a PE, if the acknowledgement means "executed".

        It means this if that manager has announced the requested phase, or the priority of the function,
        immediately before. No effect if the PE may have restarted since the request.

        kind: PHASE or PRIORITY.
        number: number of the request; for a priority, with the index of the function, as in CONTROL.
        """
        incarnation = self._health.said_incarnation(pe, self._turn.now_ns - self._lease_ns)
        if incarnation is None:
            return
        if kind == ElementKind.PRIORITY:
            self.priorities.answered(pe, incarnation, number)
        elif self._has_just_told_phase:
            self._request_accepted(pe, incarnation, number)

    def _request_accepted(self, pe: str, incarnation: int, detail: int) -> bool:
        """Note that a phase request of a PE was executed, by this manager or another one.

        detail: number of the request, with or without the bit FORWARD_ONLY.

        Returns True if this manager did not know the request before.
        """
        if not self._mission.accepted(pe, incarnation, detail):
            return False
        self._turn.keep(PhaseRequest(pe, incarnation, detail & ~FORWARD_ONLY))
        return True

    def overheard(self, manager: int, told: Control) -> Changes:
        """Take over what the active manager announces; gives the changes that follow.

        An announcement says that a fact holds, that a fault was cleared, or which request was executed.
        """
        if told.operation is Operation.ACKNOWLEDGE and told.a in (ElementKind.PHASE, ElementKind.PRIORITY):
            if told.node in self._pe_of_node:
                self._request_answered(self._pe_of_node[told.node], told.a, told.b)
            return ()
        self._has_just_told_phase = told.operation is Operation.HOLDS and told.a == ElementKind.PHASE
        causes = self.priorities.overheard(manager, told)
        if causes is not None:
            return tuple(map(PlanNeeded, causes))
        if self._has_just_told_phase:
            return self._phase_told(manager, told.b)
        element = self.failed.told(told.a, told.b)
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

    def held_no_longer(self, manager: int, *, tells_spec: bool) -> Changes:
        """Count a heartbeat of the active manager, and drop what the active manager has ceased to announce.

        This concerns latched faults and changed priorities. A manager that only advises keeps the faults that its
        operator has supposed, and all changed priorities.

        manager: node-ID of the active manager.
        tells_spec: it announces which spec flies, too.

        Returns the changes of the situation that follow.
        """
        supposed = {one.element for one in self.failed.all() if self._turn.silent and one.code == OPERATOR_CODE}
        elements = self.failed.elements - supposed
        self._untold = Counter({element: self._untold[element] + 1 for element in elements})
        facts = 1 + tells_spec + len(elements) + len(self.priorities.facts())  # the phase has its turn, too
        longest = _TURNS * ANNOUNCED_EVERY * facts
        changes: list[SituationChange] = []
        for element in sorted(elements):
            if self._untold[element] > longest:
                changes += self.clear(element, f"manager {manager}") or ()
        if not self._turn.silent:  # an adviser keeps the priorities that the operator has supposed
            changes += map(PlanNeeded, self.priorities.held_no_longer(longest))
        return changes

    def latch(self, fault: LatchedFault) -> Changes:
        """Note a fault that stays until it is cleared; gives the changes that follow."""
        is_news = fault.element not in self.failed.elements
        if self.failed.latch(fault):
            self._turn.keep(Latched(fault.element, fault.by, fault.code, fault.detail))
        if not is_news:
            return ()
        self._turn.emit(events.FaultReported, element=fault.element, by=fault.by, detail=fault.detail, code=fault.code)
        kind, _, name = fault.element.partition(":")
        changes: list[SituationChange] = []
        if kind == "pe":
            changes += self._health.bar(name, f"failed, reported by {fault.by}", self._turn.now_ns)
        if not changes:  # else the loss of the PE leads to a plan
            changes.append(PlanNeeded(f"{fault.element} failed, reported by {fault.by}"))
        return changes

    def clear(self, element: str, by: str) -> Changes | None:
        """Clear an element: its latched faults end, and a PE leaves its quarantine.

        Gives the changes that follow; None if the element had no latched fault and was not in quarantine.
        """
        faults = self.failed.clear(element)
        kind, _, name = element.partition(":")
        let_in = kind == "pe" and self._health.forgive(name)
        if not faults and not let_in:
            return None
        changes: list[SituationChange] = []
        for fault in faults:
            self._turn.keep(Cleared(fault.element))
            lacks = self._lacking.pop(fault.element, None) is not None
            if kind == "module" and (lacks or fault.code != OPERATOR_CODE):
                module, _, pe = fault.element.removeprefix("module:").partition("@")
                changes.append(ModuleReleased(module, pe or None))
        if name in self._turn.memory.quarantined and let_in:
            self._turn.keep(Released(name))
        self._turn.emit(events.FaultCleared, element=element, by=by)
        if kind != "pe":  # plans use a PE again when it joins
            changes.append(PlanNeeded(f"{element} cleared by {by}"))
        return changes

    def restore(self, element: str, by: str) -> bool:
        """End a fault that the operator alone has declared on exactly this element; tells whether there was one.

        A fault that a PE has reported stays, on the element and on the places of a module, and so does a lack of code.
        The caller reports the change.
        """
        if not self.failed.end_order(element):
            return False
        lack = self._lacking.get(element)
        if lack is not None:
            self.latch(lack)
            return False
        self._turn.keep(Cleared(element))
        self._turn.emit(events.FaultCleared, element=element, by=by)
        return True

    def enter(self, phase: str, by: str) -> Changes:
        """Enter the mission phase `phase`, and return the resulting change: a plan is needed.

        by: who has requested the phase, for events and causes.
        """
        before, self._mission.current = self._mission.current, phase
        self._turn.keep(PhaseEntered(phase))
        self._turn.emit(events.PhaseChanged, phase=phase, before=before, by=by)
        return (PlanNeeded(f"phase {phase}, requested by {by}"),)
