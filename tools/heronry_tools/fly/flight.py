"""One flight of the EAV in the single-process simulator: plant, PEs, buses, manager and plans, in virtual time.

Sensors and servos are connected to PEs as in the aircraft. Modules on PEs read the sensors, their data cross simulated
buses as frames, and a servo moves only when the agent of its PE authorizes the output. The aircraft waits on final
approach until the first configuration runs; then the time of the flight begins. From this moment on, each call that
reads or commands a device first steps the plant up to the virtual time of the call. Nothing depends on real time, so
equal missions give equal results, bit by bit. `Landing.digest` covers every frame and the state at the end.
"""

import hashlib
from collections.abc import Iterable

from heronry_agent.module import Value
from heronry_dg.model import Spec
from heronry_manager.core.vocabulary import EnterPhase
from heronry_manager.events import Reconfigured
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.fly.avionics.flight_management import Stage
from heronry_tools.fly.bus_loads import BusLoads
from heronry_tools.fly.dynamics.eav import FIRST_SURFACE_DEG
from heronry_tools.fly.dynamics.on_final import eav_on_final
from heronry_tools.fly.happenings import Happenings
from heronry_tools.fly.latency import LatencyProbe
from heronry_tools.fly.mission import Landing, Mission
from heronry_tools.fly.observation import LABELS, Observer
from heronry_tools.fly.plant import NS_PER_S, FlightPlant
from heronry_tools.fly.record import FlightRecord, Recorder
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation

_LOOK_NS = 25_000_000
_ROLLS_NS = 1 * NS_PER_S  # after the touchdown
_GONE_NS = 8 * NS_PER_S  # after the beginning of a go-around
_LONGEST_START_NS = 5 * NS_PER_S
_ROVER = ("rover", "vision")


class ReleasedPlant:
    """A plant whose time stands still until `release` starts it."""

    def __init__(self, plant: FlightPlant) -> None:
        self.plant = plant
        self._origin_ns: int | None = None

    def release(self, simulation: Simulation, look_ns: int) -> int:
        """Run the simulation until the first configuration runs, then start the plant's time.

        If none runs at 5 s of the simulator's time, the plant's time starts then. The simulation is run in steps of
        `look_ns`. Return the simulator's time (ns) at which the plant's time starts.
        """
        while not simulation.events_of(Reconfigured) and simulation.now_ns < _LONGEST_START_NS:
            simulation.run_for(look_ns)
        self._origin_ns = simulation.now_ns
        return simulation.now_ns

    def flown_ns(self, now_ns: int) -> int:
        """Return the plant's time at a time of the simulator; 0 before `release`."""
        return 0 if self._origin_ns is None else now_ns - self._origin_ns

    def read(self, device: str, now_ns: int) -> Value | None:
        """Return the reading of a device; None if it does not answer."""
        return self.plant.read(device, self.flown_ns(now_ns))

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Command an actuator; return the command that it accepted, None if it accepted none."""
        return self.plant.write(device, value, self.flown_ns(now_ns))

    def make_safe(self, device: str, now_ns: int) -> None:
        """Execute the safe action of an actuator."""
        self.plant.make_safe(device, self.flown_ns(now_ns))

    @staticmethod
    def follows(sensors: Iterable[str]) -> frozenset[str]:  # noqa: ARG004 - one plant moves everything itself
        """Return the actuators of which the plant needs output echoes: none."""
        return frozenset()

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail as `how` says; with a bias, its value is wrong by `offset`, in the unit of the device."""
        self.plant.fail(device, how, self.flown_ns(now_ns), offset)

    def heal(self, device: str) -> None:
        """Repair a device."""
        self.plant.heal(device)


class EavFlight:
    """One flight of the EAV, with the simulator that runs it."""

    def __init__(self, spec: Spec, mission: Mission, *, is_recorded: bool = True) -> None:
        """Prepare the flight.

        is_recorded: whether each call of `_look` adds a row of values to the record; the flight and its result are
            the same either way
        """
        self._spec, self._mission, self._is_recorded = spec, mission, is_recorded
        self._recorder = Recorder(spec.name, _title(mission), mission.seed)
        self.probe = LatencyProbe() if mission.probed else None
        plant = eav_on_final(mission, self._recorder, self.probe)
        self._plant, self._released = plant, ReleasedPlant(plant)
        absent = () if mission.has_rover else _ROVER
        self.simulation = Simulation(spec, mission.seed, plant=self._released, absent=absent, observed=mission.judged)
        self._observer = Observer(self.simulation, plant)
        self._loads = BusLoads(self.simulation)
        self._happenings = Happenings(spec, self.simulation, self._recorder, mission.blows)
        self._begin_ns = 0  # when the aircraft was released, on the simulator's clock
        self._went_around_ns: int | None = None
        self._errors_m: list[float] = []

    def fly(self) -> tuple[Landing, FlightRecord]:
        """Run the flight to its end, and return its result and its record.

        The flight ends a second after the touchdown, 8 s after the beginning of a go-around, or after `longest_s`.
        """
        simulation = self.simulation
        self._begin_ns = self._released.release(simulation, _LOOK_NS)
        Injections(simulation, self._mission.acts, simulation.now_ns)
        if self._mission.corrections_lost_s is not None:
            self._recorder.mark(self._mission.corrections_lost_s, "note", "the receiver's corrections are lost")
        if self._mission.must_land:
            simulation.operator.say(EnterPhase("must_land"))
        while not self._is_over():
            simulation.run_for(_LOOK_NS)
            self._look()
        return self._landing(), self._recorder.finished()

    @property
    def _flown_ns(self) -> int:
        return self._released.flown_ns(self.simulation.now_ns)

    def _is_over(self) -> bool:
        landed = self._recorder.touchdown
        if landed is not None and self._flown_ns >= landed.time_s * NS_PER_S + _ROLLS_NS:
            return True
        if self._went_around_ns is not None and self._flown_ns > self._went_around_ns + _GONE_NS:
            return True
        return self._flown_ns > self._mission.longest_s * NS_PER_S

    def _look(self) -> None:
        """Add a row to the record, and inject the faults that are due."""
        self._released.plant.advance(self._flown_ns)
        truth = self._released.plant.truth()
        if self._is_recorded:
            known = {**self._observer.columns(), **self._loads.columns(), **self._surfaces()}
            self._recorder.sample(truth, known)
        else:
            self._recorder.watch(truth)
        stage = self._observer.stage()
        self._recorder.state(truth.time_s, "mode", "flight_management", stage)
        if stage == LABELS[Stage.GO_AROUND] and self._went_around_ns is None:
            self._went_around_ns = self._flown_ns
            self._recorder.mark(truth.time_s, "refused", "the landing is refused: the aircraft goes around")
        self._observer.weigh(truth)
        if truth.height_m < 10.0 and self._recorder.touchdown is None:
            self._note_error(truth.height_m)
        self._happenings.inject_due(truth.time_s, truth.height_m)
        lost_s = self._mission.corrections_lost_s
        if lost_s is not None and self._flown_ns >= lost_s * NS_PER_S and self._recorder.touchdown is None:
            self.simulation.truth.failed("device:differential_receiver")
        self._happenings.note(self._begin_ns)

    def _note_error(self, height_m: float) -> None:
        management = self._observer.management()
        if management is not None and management.known is not None:
            self._errors_m.append(abs(management.known.height_m - height_m))

    def _surfaces(self) -> dict[str, float | None]:
        return {f"{name}_deg": self._plant.servos.surfaces[name].position for name in FIRST_SURFACE_DEG}

    def _landing(self) -> Landing:
        simulation, observer = self.simulation, self._observer
        state = f"{simulation.digest()} {self._released.plant.truth()!r}"
        return Landing(
            self._mission,
            self._recorder.touchdown,
            self._went_around_ns is not None,
            observer.mode(),
            hashlib.sha256(state.encode()).hexdigest()[:16],
            self._flown_ns / NS_PER_S,
            self._happenings.reconfigured_after_s,
            max(self._errors_m, default=None),
            tuple(total / observer.samples for total in observer.squares) if observer.samples else (),
            tuple(map(str, simulation.broken())) if self._mission.judged else (),
            () if self.probe is None else tuple(self.probe.latencies_ns),
        )


def fly_landing(spec: Spec, mission: Mission) -> Landing:
    """Run a flight, and return its result without its record."""
    return EavFlight(spec, mission, is_recorded=False).fly()[0]


def _title(mission: Mission) -> str:
    parts = [
        "with the rover" if mission.has_rover else "without the rover",
        *map(str, mission.blows),
        *map(str, mission.acts),
    ]
    return ", ".join(parts)
