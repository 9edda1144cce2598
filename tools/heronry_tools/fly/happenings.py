"""Injects the faults of a simulated flight when they are due, and records what the manager reports.

In the record, a fault or a reconfiguration is a mark at one time. A phase is a stretch of time. The time in
which a module runs on one PE in one mode is a stretch, too.
"""

from typing import cast

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.fly.mission import Blow
from heronry_tools.fly.plant import NS_PER_S
from heronry_tools.fly.record import Recorder, place_labels
from heronry_tools.sim.flight.simulation import Simulation


class Happenings:
    """Injects the faults of one flight and reads its manager's events.

    places: by module, its PE and mode in the newest plan
    phases: phases that the manager has entered, each with its time in the flight in s
    reconfigured_s: times at which a new configuration became active
    struck_s: time of the first fault; None before that
    """

    def __init__(self, spec: Spec, simulation: Simulation, recorder: Recorder, blows: tuple[Blow, ...]) -> None:
        self._spec, self._simulation, self._recorder = spec, simulation, recorder
        self._due = list(blows)
        self._seen_events = 0
        self.places: dict[str, str] = {}
        self.phases: list[tuple[str, float]] = []
        self.reconfigured_s: list[float] = []
        self.struck_s: float | None = None

    @property
    def reconfigured_after_s(self) -> float | None:
        """Return the time from the first fault to the next active configuration, in s.

        Return None if there was no fault, or no new configuration after it.
        """
        struck_s = self.struck_s
        if struck_s is None:
            return None
        return next((time_s - struck_s for time_s in self.reconfigured_s if time_s >= struck_s), None)

    def inject_due(self, time_s: float, height_m: float) -> None:
        """Inject each fault that is due and has not been injected before.

        A fault is due when its time of the flight has come, or when the aircraft is below the fault's height.
        """
        for blow in list(self._due):
            by_time = blow.at_s is not None and time_s >= blow.at_s
            if by_time or (blow.below_m is not None and height_m < blow.below_m):
                self._due.remove(blow)
                self.struck_s = time_s if self.struck_s is None else self.struck_s
                self._recorder.mark(time_s, "fault", f"{blow.element} fails ({blow.how})")
                self._inject(blow)

    def note(self, begin_ns: int) -> None:
        """Record the manager's events since the last call of this method.

        begin_ns: time of the simulator at which the flight began.
        """
        told = self._simulation.events
        for event in told[self._seen_events :]:
            self._note(event, max(event.t_ns - begin_ns, 0) / NS_PER_S)
        self._seen_events = len(told)

    def _inject(self, blow: Blow) -> None:
        simulation = self._simulation
        kind, _, name = blow.element.partition(":")
        if kind == "pe":
            simulation.fleet.kill(name)
        elif kind == "bus":
            for wire in simulation.wiring.wires[name]:
                wire.break_wire()
            simulation.truth.failed(blow.element)
        else:
            simulation.fail_device(name, cast("Failure", blow.how))

    def _note(self, event: events.Event, time_s: float) -> None:
        match event:
            case events.PlanReady(plan=plan):
                self.places = place_labels(plan)
            case events.PhaseChanged(phase=phase):
                self.phases.append((phase, time_s))
                self._recorder.state(time_s, "phase", "phase", phase)
            case events.Reconfigured(epoch=epoch, causes=causes):
                self.reconfigured_s.append(time_s)
                why = "; ".join(causes) if time_s > 0.0 else "start"
                self._recorder.mark(time_s, "reconfigured", f"configuration {epoch} runs ({why})")
                for module in self._spec.modules:
                    self._recorder.state(time_s, "place", module, self.places.get(module))
            case _:
                pass
