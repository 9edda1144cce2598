"""One flight of BIG BLUE in the single-process simulator: the shipped spec with its modules, on a simulated aircraft.

As in `heronry_tools.fly.flight`, sensors and servos are connected to PEs only, and equal missions give equal results,
bit by bit. The mission sequencer on board publishes the stage of the flight. The manager enters a phase of the spec
when the condition holds that the spec states for this phase. No operator intervenes.
"""

import hashlib

from heronry_dg.model import Spec
from heronry_tools.fly.bus_loads import BusLoads
from heronry_tools.fly.dynamics.big_blue import BigBluePlant
from heronry_tools.fly.dynamics.moving_air import MovingAir
from heronry_tools.fly.flight import ReleasedPlant
from heronry_tools.fly.glider_mission import GliderLanding, GliderMission
from heronry_tools.fly.happenings import Happenings
from heronry_tools.fly.plant import NS_PER_S, Truth
from heronry_tools.fly.record import FlightRecord, Recorder
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation

_LOOK_NS = 250_000_000
_SLIDES_NS = 2 * NS_PER_S  # after the touchdown
_STEERING = ("guidance", "elevator_control", "rudder_control")


class GliderFlight:
    """One flight of BIG BLUE, with the simulator that runs it."""

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
        self.simulation = Simulation(spec, mission.seed, plant=self._released, observed=mission.judged)
        self._happenings = Happenings(spec, self.simulation, self._recorder, mission.blows)
        self._begin_ns = 0  # when the aircraft was released, on the simulator's clock
        self._cut_m: float | None = None
        self._loads = BusLoads(self.simulation)
        self._chute_seen = False

    def fly(self) -> tuple[GliderLanding, FlightRecord]:
        """Run the flight to its end, and return its result and its record.

        The flight ends two seconds after the touchdown, or after `longest_s`.
        """
        simulation = self.simulation
        self._begin_ns = self._released.release(simulation, _LOOK_NS)
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
        """Add a row to the record, and inject the faults that are due."""
        hung = self._plant.hangs
        self._plant.advance(self._flown_ns)
        truth = self._plant.truth()
        surfaces = self._plant.servos.surfaces
        row: dict[str, float | None] = {f"{name}_deg": surfaces[name].position for name in ("elevator", "rudder")}
        self._recorder.sample(truth, {**row, **self._loads.columns(), "world_s": self._plant.world_s})
        self._note_release(truth, hung=hung)
        self._happenings.inject_due(truth.time_s, truth.height_m)
        self._happenings.note(self._begin_ns)

    def _note_release(self, truth: Truth, *, hung: bool) -> None:
        if self._cut_m is None and not self._plant.hangs and (hung or self._mission.start in ("ascent", "deployment")):
            self._cut_m = truth.height_m
            self._recorder.mark(truth.time_s, "note", f"the line is cut at {truth.height_m:.0f} m")
        if self._plant.chute and not self._chute_seen:
            self._chute_seen = True
            self._recorder.mark(truth.time_s, "note", f"the parachute opens at {truth.height_m:.0f} m")

    def _landing(self) -> GliderLanding:
        simulation = self.simulation
        state = f"{simulation.digest()} {self._plant.truth()!r}"
        places = self._happenings.places
        guided = all(name in places for name in _STEERING) and "route" in places["guidance"]
        return GliderLanding(
            self._mission,
            self._recorder.touchdown,
            tuple(self._happenings.phases),
            guided,
            self._plant.chute > 0.0,
            self._cut_m,
            self._flown_ns / NS_PER_S,
            self._plant.world_s,
            hashlib.sha256(state.encode()).hexdigest()[:16],
            tuple(map(str, simulation.broken())) if self._mission.judged else (),
        )


def fly_glider(spec: Spec, mission: GliderMission) -> GliderLanding:
    """Run a flight, and return its result without its record."""
    return GliderFlight(spec, mission).fly()[0]


def _title(mission: GliderMission) -> str:
    return ", ".join([f"from {mission.start} to the ground", *map(str, mission.blows), *map(str, mission.acts)])
