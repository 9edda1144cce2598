"""One flight of BIG BLUE in the single-process simulator: the shipped spec, its images and phases, on an aircraft.

As with the EAV (`flight`), nothing passes the bus, and equal missions give equal bits. The mission sequencer on board
says where the flight is, and the manager enters the phases of the spec by their own rules; nobody on the ground helps.
"""

import hashlib
from typing import Any, cast

from heronry_dg.model import Spec
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.fly.bus_loads import BusLoads
from heronry_tools.fly.dynamics.big_blue import BigBluePlant
from heronry_tools.fly.dynamics.moving_air import MovingAir
from heronry_tools.fly.flight import ReleasedPlant
from heronry_tools.fly.glider_mission import GliderLanding, GliderMission
from heronry_tools.fly.mission import Blow
from heronry_tools.fly.plant import NS_PER_S, Truth
from heronry_tools.fly.record import FlightRecord, Recorder
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation

_LOOK_NS = 250_000_000
_SLIDES_NS = 2 * NS_PER_S  # after the touchdown
_LONGEST_START_NS = 5 * NS_PER_S
_STEERING = ("guidance", "elevator_control", "rudder_control")


class GliderFlight:
    """One flight while it is flown."""

    def __init__(self, spec: Spec, mission: GliderMission) -> None:
        self._spec, self._mission = spec, mission
        self._recorder = Recorder(spec.name, _title(mission), mission.seed, site="field")
        self._plant = BigBluePlant(
            mission.seed,
            start=mission.start,
            air=MovingAir(mission.seed, mission.wind()),
            pace=mission.pace,
            watch=self._recorder.watch,
        )
        self._released = ReleasedPlant(self._plant)
        self.simulation = Simulation(spec, mission.seed, plant=self._released)
        self._due = list(mission.blows)
        self._places: dict[str, str] = {}
        self._phases: list[tuple[str, float]] = []
        self._seen_events = 0
        self._cut_m: float | None = None
        self._loads = BusLoads(self.simulation)
        self._chute_seen = False

    def fly(self) -> tuple[GliderLanding, FlightRecord]:
        """Fly until the aircraft has slid for two seconds, or the time is over."""
        simulation = self.simulation
        while not simulation.events_of("reconfigured") and simulation.now_ns < _LONGEST_START_NS:
            simulation.run_for(_LOOK_NS)
        self._released.release(simulation.now_ns)
        Injections(simulation, self._mission.acts, simulation.now_ns)
        self._recorder.state(0.0, "phase", "phase", next(iter(self._spec.phases), None))
        while not self._is_over():
            simulation.run_for(_LOOK_NS)
            self._look()
        return self._landing(), self._recorder.finished()

    @property
    def _flown_ns(self) -> int:
        return self._released.flown_ns(self.simulation.now_ns)

    def _is_over(self) -> bool:
        landed = self._recorder.touchdown
        if landed is not None and self._flown_ns >= landed.time_s * NS_PER_S + _SLIDES_NS:
            return True
        return self._flown_ns > self._mission.longest_s * NS_PER_S

    def _look(self) -> None:
        """Record the moment, and let happen what is due."""
        hung = self._plant.hangs
        self._plant.advance(self._flown_ns)
        truth = self._plant.truth()
        surfaces = self._plant.servos.surfaces
        row: dict[str, float | None] = {f"{name}_deg": surfaces[name].position for name in ("elevator", "rudder")}
        self._recorder.sample(truth, {**row, **self._loads.columns(), "world_s": self._plant.world_s})
        self._note_release(truth, hung=hung)
        for blow in [blow for blow in self._due if _is_due(blow, truth)]:
            self._due.remove(blow)
            self._recorder.mark(truth.time_s, "fault", f"{blow.element} fails ({blow.how})")
            self._inject(blow)
        events = self.simulation.events
        for event in events[self._seen_events :]:
            self._note(event)
        self._seen_events = len(events)

    def _note_release(self, truth: Truth, *, hung: bool) -> None:
        if self._cut_m is None and not self._plant.hangs and (hung or self._mission.start in ("ascent", "deployment")):
            self._cut_m = truth.height_m
            self._recorder.mark(truth.time_s, "note", f"the line is cut at {truth.height_m:.0f} m")
        if self._plant.chute and not self._chute_seen:
            self._chute_seen = True
            self._recorder.mark(truth.time_s, "note", f"the parachute opens at {truth.height_m:.0f} m")

    def _inject(self, blow: Blow) -> None:
        kind, _, name = blow.element.partition(":")
        if kind == "pe":
            self.simulation.fleet.kill(name)
        elif kind == "bus":
            for wire in self.simulation.wiring.wires[name]:
                wire.break_wire()
            self.simulation.truth.failed(blow.element)
        else:
            self.simulation.fail_device(name, cast("Failure", blow.how))

    def _note(self, event: dict[str, Any]) -> None:
        time_s = max(self._released.flown_ns(event["t_ns"]), 0) / NS_PER_S
        match event["event"]:
            case "plan_ready":
                self._places = {name: f"{one['pe']} ({one['mode']})" for name, one in event["plan"]["modules"].items()}
            case "phase_changed":
                phase = event["phase"]
                self._phases.append((phase, time_s))
                self._recorder.state(time_s, "phase", "phase", phase)
            case "reconfigured":
                why = "; ".join(event["causes"]) if time_s > 0.0 else "start"
                self._recorder.mark(time_s, "reconfigured", f"configuration {event['epoch']} runs ({why})")
                for module in self._spec.modules:
                    self._recorder.state(time_s, "place", module, self._places.get(module))
            case _:
                pass

    def _landing(self) -> GliderLanding:
        simulation = self.simulation
        state = f"{simulation.digest()} {self._plant.truth()!r}"
        places = self._places
        guided = all(name in places for name in _STEERING) and "route" in places["guidance"]
        return GliderLanding(
            self._mission,
            self._recorder.touchdown,
            tuple(self._phases),
            guided,
            self._plant.chute > 0.0,
            self._cut_m,
            self._flown_ns / NS_PER_S,
            self._plant.world_s,
            hashlib.sha256(state.encode()).hexdigest()[:16],
            tuple(map(str, simulation.broken())) if self._mission.judged else (),
        )


def fly_glider(spec: Spec, mission: GliderMission) -> GliderLanding:
    """Fly a mission, and give what came of it, without the record."""
    return GliderFlight(spec, mission).fly()[0]


def _is_due(blow: Blow, truth: Truth) -> bool:
    by_time = blow.at_s is not None and truth.time_s >= blow.at_s
    return by_time or (blow.below_m is not None and truth.height_m < blow.below_m)


def _title(mission: GliderMission) -> str:
    return ", ".join([f"from {mission.start} to the ground", *map(str, mission.blows), *map(str, mission.acts)])
