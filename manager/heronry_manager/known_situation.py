"""The situation as the manager knows it: what is down, and the mission phase. Whatever changes it asks for a new plan.

Down is what is latched (`latched_faults`), and every PE that is not counted on (`health`). The phase is
`mission_phase`'s. What a lost, late, doubled or forged message does to either is written there.

A PE that is latched is barred: it may speak as well as it likes, nobody counts on it until it is cleared.
"""

from collections.abc import Callable

from heronry_dg.model import Spec
from heronry_manager.health import Health, HealthChange
from heronry_manager.latched_faults import LatchedFault, LatchedFaults
from heronry_manager.mission_phase import MissionPhase
from heronry_manager.turn import Turn
from heronry_wire.management import Emergency


class KnownSituation:
    """What is down, and the phase."""

    def __init__(
        self,
        spec: Spec,
        turn: Turn,
        health: Health,
        take: Callable[[list[HealthChange]], None],
        replan: Callable[[str], None],
    ) -> None:
        """`take` is given changes of health that were made here, `replan` the cause of any other change."""
        self._spec, self._turn, self._health = spec, turn, health
        self._take, self._replan = take, replan
        self._mission = MissionPhase(spec)
        self.failed = LatchedFaults(spec)

    @property
    def phase(self) -> str | None:
        """Mission phase that plans are made for; None where the spec has none."""
        return self._mission.current

    def down(self) -> frozenset[str]:
        """Everything that is down, as `kind:name`."""
        missing = (f"pe:{pe}" for pe in self._spec.pes if not self._health.is_counted_on(pe))
        return self.failed.elements | frozenset(missing)

    def reported(self, pe: str, emergency: Emergency) -> bool:
        """A PE reports a fault; tells whether that was understood."""
        element = self.failed.element(emergency.kind, emergency.index)
        if element is None:
            return False
        self.latch(LatchedFault(element, pe, emergency.code.name, emergency.detail, self._turn.now_ns))
        return True

    def requested(self, pe: str, request: Emergency) -> bool:
        """A PE asks for a phase; tells whether that was heard."""
        if not self._health.is_counted_on(pe) or not self._mission.knows(request.index):
            return False
        phase = self._mission.requested(pe, request.index, request.detail)
        if phase is not None:
            self.enter(phase, pe)
        return True

    def lost(self, pe: str) -> None:
        """A PE is counted on no more."""
        self._mission.forget(pe)

    def latch(self, fault: LatchedFault) -> None:
        """An element has failed, as somebody says."""
        if not self.failed.latch(fault):
            return
        self._turn.emit("fault_reported", element=fault.element, by=fault.by, detail=fault.detail, code=fault.code)
        cause = f"{fault.element} failed, reported by {fault.by}"
        kind, _, name = fault.element.partition(":")
        counted_on = kind == "pe" and self._health.is_counted_on(name)
        changes = self._health.bar(name, f"failed, reported by {fault.by}", self._turn.now_ns) if kind == "pe" else []
        self._take(changes)
        if not counted_on:
            self._replan(cause)

    def clear(self, element: str, by: str) -> bool:
        """An element is taken for well again; tells whether anything was held against it."""
        fault = self.failed.clear(element)
        kind, _, name = element.partition(":")
        let_in = kind == "pe" and self._health.forgive(name)
        if fault is None and not let_in:
            return False
        self._turn.emit("fault_cleared", element=element, by=by)
        if kind != "pe":  # a PE is planned with when it has joined
            self._replan(f"{element} cleared by {by}")
        return True

    def enter(self, phase: str, by: str) -> None:
        """Somebody wants another mission phase."""
        before, self._mission.current = self._mission.current, phase
        self._turn.emit("phase_changed", phase=phase, before=before, by=by)
        self._replan(f"phase {phase}, asked for by {by}")
