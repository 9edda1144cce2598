"""The Exploration Aerial Vehicle on final: dynamics, sensors, servos, and the rover's camera beside the runway.

Values in mdeg/s, mdeg, mm/s, mm, 0.1 mrad and ms are whole numbers, as such devices give them.

Sensors, and what they read:

    ins_1, ins_2             roll, pitch and yaw rate (mdeg/s), roll, pitch (mdeg), velocity north, east, up (mm/s)
    pitot_1, pitot_2         airspeed (m/s)
    differential_receiver    x, y, height (mm), good to decimetres until corrections are lost, then as bad as `gps`
    gps                      x, y, height (mm), height with a bias of 3.5 to 7 m
    camera                   azimuth, elevation (0.1 mrad), age of the image (ms); empty before the first image
    head_encoder             azimuth, elevation (0.1 mrad) to which the head points
    elevator_sensor, aileron_sensor, rudder_sensor    angle of the surface (deg)
    throttle_sensor          0 to 1

Actuators, and what they are commanded to:

    elevator_1, elevator_2, aileron_1, aileron_2, rudder_1, rudder_2    angle of the surface (deg)
    throttle_1, throttle_2   0 to 1
    pan_tilt                 azimuth, elevation (0.1 mrad) to which the head is to point

The elevator is positive down, the aileron positive for a roll to the right, the rudder positive for a yaw to the left.
"""

import math
from collections.abc import Callable
from random import Random

from heronry_agent.module import Value
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.fly.camera import Camera, angles_rad
from heronry_tools.fly.dynamics.failed_devices import FailedDevices
from heronry_tools.fly.dynamics.model import M_PER_FT, Air, Model
from heronry_tools.fly.latency import LatencyProbe
from heronry_tools.fly.plant import NS_PER_S, STEPS_PER_S, Truth
from heronry_tools.fly.sensors import SensorError
from heronry_tools.fly.servos import Servos, Surface

CENTRE_ABOVE_WHEELS_M = 0.30
FIRST_SURFACE_DEG = {"elevator": 25.0, "aileron": 20.0, "rudder": 25.0}
INERTIAL_UNITS, PITOTS = ("ins_1", "ins_2"), ("pitot_1", "pitot_2")
DEVICES = (
    *(*INERTIAL_UNITS, *PITOTS, "differential_receiver", "gps", "camera", "head_encoder"),
    *("elevator_sensor", "aileron_sensor", "rudder_sensor", "throttle_sensor"),
)  # the sensors
_SURFACE_DEG_PER_S = 300.0
_THROTTLE_PER_S = 2.0
_HEAD_RAD_PER_S = 1.5
_HEAD_START_RAD = (0.0, 0.08)
_FULL_TRIM = 1  # JSBSim's number for a trim of all axes
_INERTIAL_EVERY = 3  # steps of the model between two samples: 40 Hz
_POSITION_EVERY = 12  # steps of the model between two positions of a receiver: 10 Hz
_FAST_S, _SLOW_S = _INERTIAL_EVERY / STEPS_PER_S, _POSITION_EVERY / STEPS_PER_S
_CONTACTS = {
    name: f"{kind}/unit[{index}]/WOW"  # JSBSim numbers wheels and structure in one sequence
    for index, (kind, name) in enumerate(
        [("gear", name) for name in ("nose_wheel", "left_wheel", "right_wheel")]
        + [("contact", name) for name in ("propeller", "tail", "left_tip", "right_tip")]
    )
}
_INERTIAL = (
    # Property of JSBSim, factor to the unit of the reading; standard deviations, in this unit, of white noise and bias.
    ("velocities/p-rad_sec", math.degrees(1000.0), 200.0, 50.0),
    ("velocities/q-rad_sec", math.degrees(1000.0), 200.0, 50.0),
    ("velocities/r-rad_sec", math.degrees(1000.0), 200.0, 50.0),
    ("attitude/phi-rad", math.degrees(1000.0), 150.0, 300.0),
    ("attitude/theta-rad", math.degrees(1000.0), 150.0, 300.0),
    ("velocities/v-north-fps", 1000.0 * M_PER_FT, 100.0, 80.0),
    ("velocities/v-east-fps", 1000.0 * M_PER_FT, 100.0, 80.0),
    ("velocities/v-down-fps", -1000.0 * M_PER_FT, 100.0, 80.0),
)
_PITCH_RATE = 1  # its place in `_INERTIAL`
_MRAD_TENTHS = 10_000.0
_NEAR_GROUND_FT = 5.0


class EavPlant:
    """The plant of the EAV, from a start on final approach; `heronry_tools.fly.plant` explains plants."""

    def __init__(
        self,
        seed: int,
        *,
        air: Air | None = None,
        start_m: tuple[float, float, float] = (-620.0, 0.0, 45.0),
        airspeed_m_per_s: float = 18.0,
        corrections_lost_s: float | None = None,
        height_bias_m: float = 0.0,
        perfect: bool = False,
        held: bool = False,
        watch: Callable[[Truth], None] | None = None,
        probe: LatencyProbe | None = None,
    ) -> None:
        """Place the aircraft in trimmed flight on final approach.

        air: the moving air; None: the air is still
        start_m: x, y and height
        corrections_lost_s: time of the flight from which the differential receiver is inaccurate; None: it never is
        height_bias_m: a constant error of the differential receiver's height, in addition to its usual errors
        perfect: whether only the camera has errors, and no other sensor
        held: whether the aircraft is held at its start until `release`; its sensors and servos work meanwhile
        watch: is called with the state after each step near the ground
        probe: adds step changes to the measured pitch rate, to measure the latency to the servo
        """
        self._seed, self._air, self._perfect = seed, air, perfect
        self._lost_s, self._watch, self._probe = corrections_lost_s, watch, probe
        self._model = Model("eav", seed=seed)
        x_m, y_m, height_m = start_m
        self._model.start(
            north_m=x_m,
            east_m=y_m,
            up_m=height_m + CENTRE_ABOVE_WHEELS_M,
            airspeed_m_per_s=airspeed_m_per_s,
            heading_deg=0.0,
        )
        elevator_deg, throttle = self._trimmed()
        if air is not None:
            air.begin(self._model)
        self._steps = 0
        self._begun_steps: int | None = None if held else 0  # when the flight began
        self._failed = FailedDevices()
        self._readings: dict[str, Value] = {}
        surfaces = {name: Surface(-limit, limit, _SURFACE_DEG_PER_S) for name, limit in FIRST_SURFACE_DEG.items()} | {
            "throttle": Surface(0.0, 1.0, _THROTTLE_PER_S, throttle, throttle)
        }
        surfaces["elevator"].position = surfaces["elevator"].target = elevator_deg
        self.servos = Servos(surfaces, {f"{name}_{number}": name for name in surfaces for number in (1, 2)})
        self.head_rad, self._head_demand_rad = _HEAD_START_RAD, _HEAD_START_RAD
        self.camera = Camera(seed)
        self._errors = self._drawn_errors(seed)
        self._errors["precise/h"].bias += height_bias_m
        self._sample()

    # What devices do

    def advance(self, time_ns: int) -> None:
        """Step the model up to the last step at or before `time_ns`.

        An earlier time than the present one has no effect.
        """
        due = time_ns * STEPS_PER_S // NS_PER_S
        while self._steps < due:
            self._step()

    def read(self, device: str, now_ns: int) -> Value | None:
        """Advance to `now_ns`, and return the reading of a device; None if it does not answer."""
        self.advance(now_ns)
        if device in self.servos.pushes:
            return self.servos.read(device)
        return self._failed.read(device, lambda: self._reading(device, now_ns))

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Advance to `now_ns` and command an actuator.

        Returns the command that the actuator accepted; None if the actuator accepted none.
        """
        self.advance(now_ns)
        if device == "pan_tilt":
            if not isinstance(value, tuple) or len(value) != 2:
                raise TypeError(f"pan_tilt needs azimuth and elevation as its command, not {value!r}")
            self._head_demand_rad = value[0] / _MRAD_TENTHS, value[1] / _MRAD_TENTHS
            return value
        if not isinstance(value, (int, float)):
            raise TypeError(f"{device} needs a number as its command, not {value!r}")
        if self._probe is not None:
            self._probe.commanded(device, value, now_ns - (self._begun_steps or 0) * NS_PER_S // STEPS_PER_S)
        return self.servos.command(device, float(value)) if device in self.servos.pushes else value

    def release(self, now_ns: int) -> None:
        """Advance to `now_ns` and let the held aircraft fly; the time of the flight counts from now on."""
        self.advance(now_ns)
        self._begun_steps = self._steps

    def make_safe(self, device: str, now_ns: int) -> None:
        """Do nothing: a servo holds its angle without a command."""

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail; a `dead` camera gives no new images.

        offset: for `how` = "bias", what is added to each reading of a sensor, or to each command of a servo.
        """
        self.advance(now_ns)
        if device in self.servos.pushes:
            self.servos.fail(device, how, offset)
        elif device == "camera" and how == "dead":
            self.camera.blind = True
        else:
            self._failed.fail(device, how, self._reading(device, now_ns), offset)

    def heal(self, device: str) -> None:
        """Repair a device."""
        self._failed.heal(device)
        self.servos.heal(device)
        if device == "camera":
            self.camera.blind = False

    def truth(self) -> Truth:
        """Return the true state of the aircraft now."""
        fdm = self._model.fdm
        north_m, east_m, up_m = self._model.position_m()
        touching = tuple(name for name, is_down in _CONTACTS.items() if fdm[is_down])
        return Truth(
            time_s=self._flown_steps / STEPS_PER_S,
            x_m=north_m,
            y_m=east_m,
            height_m=up_m - CENTRE_ABOVE_WHEELS_M,
            north_m_per_s=fdm["velocities/v-north-fps"] * M_PER_FT,
            east_m_per_s=fdm["velocities/v-east-fps"] * M_PER_FT,
            up_m_per_s=-fdm["velocities/v-down-fps"] * M_PER_FT,
            roll_deg=fdm["attitude/phi-deg"],
            pitch_deg=fdm["attitude/theta-deg"],
            heading_deg=fdm["attitude/psi-deg"],
            airspeed_m_per_s=fdm["velocities/vt-fps"] * M_PER_FT,
            load_factor_g=fdm["accelerations/Nz"],
            touching=touching,
        )

    def slow_errors(self) -> tuple[float, ...]:
        """Return the slow errors of the GPS receiver without corrections (x, y, height, m), and of the camera (rad)."""
        return *(self._errors[f"gps/{axis}"].slow for axis in "xyh"), *self.camera.bias_rad

    # The world

    @property
    def _flown_steps(self) -> int:
        return 0 if self._begun_steps is None else self._steps - self._begun_steps

    def _trimmed(self) -> tuple[float, float]:
        """Trim the aircraft for level flight without wind.

        Returns the angle of the elevator in degrees and the throttle (0 to 1) that this flight needs.
        """
        fdm = self._model.fdm
        fdm.do_trim(_FULL_TRIM)
        elevator_deg = fdm["fcs/pitch-trim-cmd-norm"] * FIRST_SURFACE_DEG["elevator"]
        fdm["fcs/pitch-trim-cmd-norm"] = 0.0
        return elevator_deg, fdm["fcs/throttle-cmd-norm"]

    def _step(self) -> None:
        dt_s = 1.0 / STEPS_PER_S
        self.servos.step(dt_s)
        if self._begun_steps is not None:
            self._move()
        self._steps += 1
        self._move_head(dt_s)
        self._sample()
        if self._watch is not None and self._model.fdm["position/h-agl-ft"] < _NEAR_GROUND_FT:
            self._watch(self.truth())

    def _move(self) -> None:
        model, fdm, servos = self._model, self._model.fdm, self.servos
        for name, limit in FIRST_SURFACE_DEG.items():
            fdm[f"fcs/{name}-cmd-norm"] = servos.surfaces[name].position / limit
        fdm["fcs/throttle-cmd-norm"] = servos.surfaces["throttle"].position
        if self._air is not None:
            self._air.step(model, fdm["position/h-agl-ft"] * M_PER_FT)
        model.step()

    def _move_head(self, dt_s: float) -> None:
        most = _HEAD_RAD_PER_S * dt_s
        azimuth, elevation = (
            is_rad + min(max(to_rad - is_rad, -most), most)
            for is_rad, to_rad in zip(self.head_rad, self._head_demand_rad, strict=True)
        )
        self.head_rad = azimuth, elevation

    def _sample(self) -> None:
        if self._steps % _INERTIAL_EVERY == 0:
            self._sample_fast()
        if self._steps % _POSITION_EVERY == 0:
            self._sample_position()

    def _sample_fast(self) -> None:
        fdm, error = self._model.fdm, self._error
        exact = [fdm[name] * factor for name, factor, _, _ in _INERTIAL]
        if self._probe is not None:
            exact[_PITCH_RATE] += 1000.0 * self._probe.offset_deg_per_s(self._flown_steps * NS_PER_S // STEPS_PER_S)
        for unit in INERTIAL_UNITS:
            self._readings[unit] = tuple(round(value + error(f"{unit}/{i}")) for i, value in enumerate(exact))
        airspeed = fdm["velocities/vt-fps"] * M_PER_FT
        for unit in PITOTS:
            self._readings[unit] = max(airspeed + error(unit), 0.0)
        x_m, y_m, up_m = self._model.position_m()
        self.camera.step(self._steps * NS_PER_S // STEPS_PER_S, angles_rad(x_m, y_m, up_m), self.head_rad)

    def _sample_position(self) -> None:
        x_m, y_m, up_m = self._model.position_m()
        exact = x_m, y_m, up_m - CENTRE_ABOVE_WHEELS_M
        is_lost = self._lost_s is not None and self._flown_steps >= self._lost_s * STEPS_PER_S
        for unit, kind in (("gps", "gps"), ("differential_receiver", "lost" if is_lost else "precise")):
            values = (value + self._error(f"{kind}/{axis}") for value, axis in zip(exact, "xyh", strict=True))
            self._readings[unit] = tuple(round(1000.0 * value) for value in values)

    def _reading(self, device: str, now_ns: int) -> Value:
        if device == "camera":
            return self._image(now_ns)
        if device == "head_encoder":
            return tuple(round(_MRAD_TENTHS * angle) for angle in self.head_rad)
        surface = self.servos.surfaces.get(device.removesuffix("_sensor"))
        if surface is not None:
            return surface.position
        return self._readings.get(device, 0.0)

    def _image(self, now_ns: int) -> Value:
        newest = self.camera.newest()
        if newest is None:
            return ()
        exposed_ns, angles = newest
        age_ms = (now_ns - exposed_ns) // 1_000_000
        return (*(round(_MRAD_TENTHS * angle) for angle in angles), age_ms)

    def _error(self, name: str) -> float:
        return 0.0 if self._perfect else self._errors[name].sample()

    def _drawn_errors(self, seed: int) -> dict[str, SensorError]:
        chance = Random(f"{seed} biases")
        errors = {}
        for unit in INERTIAL_UNITS:
            for i, (_, _, white, bias) in enumerate(_INERTIAL):
                name = f"{unit}/{i}"
                errors[name] = SensorError(seed, name, white=white, bias=chance.gauss(0.0, bias), period_s=_FAST_S)
        for unit in PITOTS:
            errors[unit] = SensorError(seed, unit, white=0.3, bias=chance.gauss(0.0, 0.4), period_s=_FAST_S)
        for kind in ("gps", "lost"):
            biases = chance.gauss(0.0, 3.0), chance.gauss(0.0, 3.0), chance.choice((-1, 1)) * chance.uniform(3.5, 7.0)
            for axis, bias in zip("xyh", biases, strict=True):
                name = f"{kind}/{axis}"
                errors[name] = SensorError(seed, name, white=0.3, bias=bias, drift=0.7, period_s=_SLOW_S)
        for axis in "xyh":
            name = f"precise/{axis}"
            errors[name] = SensorError(seed, name, white=0.05, bias=chance.gauss(0.0, 0.15), period_s=_SLOW_S)
        return errors
