"""BIG BLUE III in JSBSim: it rises below its balloon, inflates its wings, is released, glides home and lands.

The devices are those of the shipped spec `big_blue`. Their readings and errors come from
`heronry_tools.aircraft.plant.devices`, as in the scripted plant; but here the surfaces steer the aircraft.

*Balloon.* The gas lifts 12 N more than the weight, at any height. The bag grows as the air thins, so its drag falls
with the third root of the density. The aircraft rises at 5 m/s near the ground, and at 7 m/s at 20 km. The line pulls
at a point above the centre of gravity. A burn wire cuts the line for good. A charge opens the parachute for good, and
so folds the wings.

*Wings.* At a pressure p below 430 hPa the wings carry only the share p / 430 hPa of their full forces. Once light has
cured their skin, they carry their full forces at any pressure.

*Time.* While the aircraft hangs on the line, its surfaces have no effect. The time of the plant may then pass faster
than the avionics' clock: the plant makes `pace` steps for each step of the avionics. The plant keeps to the avionics'
clock in three cases:

    - near the ground
    - at and above the lowest height at which the line may be cut, and a little below it
    - while the inflation valve is open

Angular rates are given per second of the avionics' clock.

*Inertial units.* The gyros of this aircraft give the rates of the pitch and roll angles. An inertial unit removes the
acceleration of the flight path, which the airspeed shows, from the readings of its accelerometers. So it does not
mistake a turn for level flight.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from heronry_agent.module import Value
from heronry_tools.aircraft.images import atmosphere
from heronry_tools.aircraft.images.guidance import (
    HOME_ALTITUDE_M,
    HOME_LATITUDE_DEG,
    HOME_LONGITUDE_DEG,
    M_PER_DEG_LATITUDE,
)
from heronry_tools.aircraft.plant.devices import GPS_PERIOD_NS, SENSORS, WING_SUPPLY_HPA, Surroundings, reading
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.aircraft.plant.mechanism import Mechanism
from heronry_tools.fly.dynamics.failed_devices import FailedDevices
from heronry_tools.fly.dynamics.model import M_PER_FT, Air, Model
from heronry_tools.fly.plant import NS_PER_S, STEPS_PER_S, Truth
from heronry_tools.fly.servos import Servos, Surface

Start = Literal["ascent", "deployment", "glide", "landing"]

_N_PER_LBF = 4.4482216
_CENTRE_ABOVE_SKIDS_M = 0.15
_STOP_DEG = 25.0
_SURFACE_DEG_PER_S = 200.0
_WEIGHT_N = 5.5 * 9.80665
_FREE_LIFT_N = 12.0
_BAG_DRAG = 0.48  # N per (m/s)^2 at sea level: 5 m/s with the free lift
_FIRM_HPA = 430.0
_CURES_S = 12.0  # time under pressure until light has cured the skin; shortened, like the dose in the avionics
_LEAST_WINGS = 0.06  # share of their full forces that folded wings carry
_CHUTE_OPENS_S = 1.0
_QUICK_ABOVE_M, _QUICK_BELOW_M = 50.0, 19_300.0  # heights above the field between which time may pass faster
_NEAR_GROUND_FT = 6.0
_M_PER_DEG_LONGITUDE = M_PER_DEG_LATITUDE * math.cos(math.radians(HOME_LATITUDE_DEG))
_WIRES, _CHARGES = frozenset(("burn_wire_1", "burn_wire_2")), frozenset(("chute_charge_1", "chute_charge_2"))
_SKIDS = ("nose_skid", "left_skid", "right_skid")
_STRUCTURE = ("nose", "tail", "left_tip", "right_tip")


@dataclass(frozen=True, slots=True)
class _StartingPoint:
    north_m: float
    east_m: float
    height_m: float
    hangs: bool
    wing_hpa: float


_STARTS: dict[Start, _StartingPoint] = {
    "ascent": _StartingPoint(0.0, 0.0, 0.0, hangs=True, wing_hpa=0.0),
    "deployment": _StartingPoint(3_000.0, 22_000.0, 15_500.0, hangs=True, wing_hpa=0.0),
    "glide": _StartingPoint(-800.0, 2_500.0, 2_000.0, hangs=False, wing_hpa=520.0),
    "landing": _StartingPoint(-300.0, 900.0, 1_150.0, hangs=False, wing_hpa=520.0),
}


@dataclass(frozen=True, slots=True)
class Motion:
    """State of the aircraft from which sensors make their readings.

    The fields have the same names as the fields of `Moment` (`heronry_tools.aircraft.plant.flight`).
    """

    time_s: float
    altitude_m: float
    latitude_deg: float
    longitude_deg: float
    track_deg: float
    airspeed_m_per_s: float  # indicated, along the nose
    pitch_deg: float
    roll_deg: float
    pitch_rate_deg_per_s: float
    roll_rate_deg_per_s: float


class BigBluePlant:
    """The plant of BIG BLUE III, from the beginning of one phase of its mission.

    `heronry_tools.fly.plant` explains plants.
    """

    def __init__(
        self,
        seed: int,
        *,
        start: Start = "ascent",
        air: Air | None = None,
        pace: int = 1,
        watch: Callable[[Truth], None] | None = None,
    ) -> None:
        """Place the aircraft at the beginning of `start`.

        air: the moving air; None: the air is still
        pace: steps of the plant for one step of the avionics, while the aircraft hangs on its line
        watch: is called with the state after each step near the ground, once the line is cut
        """
        self._seed, self._air, self.pace, self._watch = seed, air, pace, watch
        point = _STARTS[start]
        self._model = Model("big_blue", seed=seed)
        self.hangs, self.chute = point.hangs, 0.0
        self._chute_fired = False
        self._place(point)
        if air is not None:
            air.begin(self._model)
        self._ticks = 0  # of the avionics' clock, 120 to the second
        self._steps = 0
        self._wing_hpa = point.wing_hpa
        self._firm_s = _CURES_S if point.wing_hpa >= _FIRM_HPA else 0.0
        self._wing = Mechanism(rise_s=6.0, fall_s=1800.0)
        self._valve = 0.0
        surfaces = {name: Surface(-_STOP_DEG, _STOP_DEG, _SURFACE_DEG_PER_S) for name in ("elevator", "rudder")}
        self.servos = Servos(surfaces, {f"{name}_servo_{number}": name for name in surfaces for number in (1, 2)})
        self._failed = FailedDevices()
        self._written: dict[str, Value] = {}
        self._motion: Motion | None = None

    # What devices do

    def advance(self, time_ns: int) -> None:
        """Step the model up to the last step at or before `time_ns`.

        An earlier time than the present one has no effect.
        """
        due = time_ns * STEPS_PER_S // NS_PER_S
        while self._ticks < due:
            self._tick()

    def read(self, device: str, now_ns: int) -> Value | None:
        """Advance to `now_ns`, and return the reading of a device; None if the device does not answer."""
        self.advance(now_ns)
        if device in self.servos.pushes:
            return self.servos.read(device)
        return self._failed.read(device, lambda: self._reading(device, now_ns))

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Advance to `now_ns` and command an actuator.

        Return the command that the actuator has accepted, or None if it has accepted none.
        """
        self.advance(now_ns)
        if device in self.servos.pushes:
            return self.servos.command(device, _as_number(device, value))
        if device in self._failed:
            return None
        self._written[device] = value
        if device in _WIRES and _as_number(device, value) != 0:
            self.hangs = False
        elif device in _CHARGES and _as_number(device, value) != 0:
            self._chute_fired = True
        elif device == "inflation_valve":
            self._move_valve(_as_number(device, value), now_ns)
        return value

    def make_safe(self, device: str, now_ns: int) -> None:
        """Do nothing: an actuator of this aircraft holds its position without a command."""

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail as `how` says.

        A charge or a burn wire that has failed does not fire; a valve that has failed does not move.
        offset: for the failure `bias`, the error in the device's own unit.
        """
        self.advance(now_ns)
        if device in self.servos.pushes:
            self.servos.fail(device, how, offset)
        else:
            self._failed.fail(device, how, self._reading(device, now_ns), offset)

    def heal(self, device: str) -> None:
        """Repair a device."""
        self._failed.heal(device)
        self.servos.heal(device)

    @property
    def world_s(self) -> float:
        """Return the plant's time since the start, in s.

        While the aircraft hangs on the line, this time may pass faster than the avionics' clock (`pace`).
        """
        return self._steps / STEPS_PER_S

    def truth(self) -> Truth:
        """Return the present state; x is north of home, y is east of home."""
        fdm = self._model.fdm
        north_m, east_m, up_m = self._model.position_m()
        return Truth(
            time_s=self._ticks / STEPS_PER_S,
            x_m=north_m,
            y_m=east_m,
            height_m=up_m - _CENTRE_ABOVE_SKIDS_M,
            north_m_per_s=fdm["velocities/v-north-fps"] * M_PER_FT,
            east_m_per_s=fdm["velocities/v-east-fps"] * M_PER_FT,
            up_m_per_s=-fdm["velocities/v-down-fps"] * M_PER_FT,
            roll_deg=fdm["attitude/phi-deg"],
            pitch_deg=fdm["attitude/theta-deg"],
            heading_deg=fdm["attitude/psi-deg"],
            airspeed_m_per_s=fdm["velocities/vt-fps"] * M_PER_FT,
            load_factor_g=fdm["accelerations/Nz"],
            touching=self._touching(),
        )

    # The world

    def _place(self, point: _StartingPoint) -> None:
        fdm = self._model.fdm
        fdm["big_blue/wings"] = 1.0 if point.wing_hpa >= _FIRM_HPA else _LEAST_WINGS
        fdm["ic/terrain-elevation-ft"] = HOME_ALTITUDE_M / M_PER_FT
        fdm["ic/lat-geod-deg"] = math.degrees(point.north_m / 6_335_439.3)
        fdm["ic/long-gc-deg"] = math.degrees(point.east_m / 6_378_137.0)
        fdm["ic/h-sl-ft"] = (HOME_ALTITUDE_M + point.height_m + _CENTRE_ABOVE_SKIDS_M) / M_PER_FT
        if not point.hangs:
            fdm["ic/psi-true-deg"] = 270.0
            fdm["ic/vc-kts"] = 18.0 / 0.514444
            fdm["ic/alpha-deg"] = 3.0
            fdm["ic/gamma-deg"] = -7.0
        fdm.run_ic()

    def _tick(self) -> None:
        self._ticks += 1
        for _ in range(self._pace()):
            self._step()
        self._motion = None
        if self._watch is not None and not self.hangs and self._model.fdm["position/h-agl-ft"] < _NEAR_GROUND_FT:
            self._watch(self.truth())

    def _pace(self) -> int:
        height_m = self._model.fdm["position/h-agl-ft"] * M_PER_FT
        is_quick = self.hangs and self._valve == 0.0 and _QUICK_ABOVE_M < height_m < _QUICK_BELOW_M
        return self.pace if is_quick else 1

    def _step(self) -> None:
        model, fdm, servos = self._model, self._model.fdm, self.servos
        dt_s = 1.0 / STEPS_PER_S
        servos.step(dt_s)
        fdm["fcs/elevator-cmd-norm"] = servos.surfaces["elevator"].position / _STOP_DEG
        fdm["fcs/rudder-cmd-norm"] = -servos.surfaces["rudder"].position / _STOP_DEG  # positive in JSBSim: yaws left
        if self._air is not None:
            self._air.step(model, fdm["position/h-agl-ft"] * M_PER_FT)
        if self._chute_fired and self.chute < 1.0:
            self.chute = min(self.chute + dt_s / _CHUTE_OPENS_S, 1.0)
            fdm["big_blue/chute"] = self.chute
        fdm["big_blue/wings"] = max(self._shape(dt_s) * (1.0 - self.chute), _LEAST_WINGS)
        fdm["big_blue/damped"] = max(float(self.hangs), self.chute)
        self._pull()
        model.step()
        self._steps += 1

    def _shape(self, dt_s: float) -> float:
        """Advance the curing by `dt_s`; return which share (0 to 1) of their full forces the wings carry.

        The share follows the pressure in the wings. Once the skin has cured under pressure, the share is always 1.
        """
        firm = min(self._pressure_hpa(self._now_ns()) / _FIRM_HPA, 1.0)
        if self._firm_s >= _CURES_S:
            return 1.0
        self._firm_s += dt_s if firm >= 1.0 else 0.0
        return firm

    def _pull(self) -> None:
        """Apply the force of the line: the lift of the gas and the drag of the bag in the air around it."""
        fdm = self._model.fdm
        if not self.hangs:
            fdm["external_reactions/line/magnitude"] = 0.0
            return
        thinned = (fdm["atmosphere/rho-slugs_ft3"] * 515.379 / atmosphere.SEA_LEVEL_DENSITY_KG_PER_M3) ** (1.0 / 3.0)
        flow = [
            (fdm[f"velocities/v-{axis}-fps"] - fdm[f"atmosphere/total-wind-{axis}-fps"]) * M_PER_FT
            for axis in ("north", "east", "down")
        ]
        drag = _BAG_DRAG * thinned * math.sqrt(sum(part * part for part in flow))
        force = [-drag * part for part in flow]
        force[2] -= _WEIGHT_N + _FREE_LIFT_N
        pull = math.sqrt(sum(part * part for part in force))
        fdm["external_reactions/line/magnitude"] = pull / _N_PER_LBF
        for axis, part in zip("xyz", force, strict=True):
            fdm[f"external_reactions/line/{axis}"] = part / pull

    def _move_valve(self, opening: float, now_ns: int) -> None:
        if opening != self._valve:
            self._wing.push(WING_SUPPLY_HPA * opening, now_ns, self._wing_hpa)
            self._valve = opening

    def _pressure_hpa(self, now_ns: int) -> float:
        return self._wing.position(now_ns, self._wing_hpa)

    def _now_ns(self) -> int:
        return self._ticks * NS_PER_S // STEPS_PER_S

    def _touching(self) -> tuple[str, ...]:
        fdm = self._model.fdm
        skids = tuple(name for i, name in enumerate(_SKIDS) if fdm[f"gear/unit[{i}]/WOW"])
        first = len(_SKIDS)
        return skids + tuple(n for i, n in enumerate(_STRUCTURE) if fdm[f"contact/unit[{first + i}]/WOW"])

    # Readings

    def _reading(self, device: str, now_ns: int) -> Value:
        if device in self._written:
            return self._written[device]
        surface = self.servos.surfaces.get(device.removesuffix("_angle_sensor"))
        if device not in SENSORS and surface is None:
            return 0.0
        time_ns = now_ns
        if device == "gps":
            time_ns -= time_ns % GPS_PERIOD_NS
        if device in ("command_receiver", "console"):
            return (0, 0)  # the ground gives no command
        return reading(Surroundings(device, time_ns, self._moved(), self._position, _still, self._seed))

    def _position(self, mechanism: str) -> float:
        if mechanism == "wing":
            return self._pressure_hpa(self._now_ns())
        surface = self.servos.surfaces.get(mechanism)
        return surface.position if surface is not None else 0.0  # the airframe's motion is in `Motion`

    def _moved(self) -> Motion:
        if self._motion is None:
            self._motion = self._moving()
        return self._motion

    def _moving(self) -> Motion:
        fdm, pace = self._model.fdm, self._pace()
        north_m, east_m, up_m = self._model.position_m()
        north, east = fdm["velocities/v-north-fps"], fdm["velocities/v-east-fps"]
        along = max(fdm["velocities/u-aero-fps"], 0.0) * M_PER_FT
        density = fdm["atmosphere/rho-slugs_ft3"] * 515.379
        return Motion(
            time_s=self.world_s,
            altitude_m=HOME_ALTITUDE_M + up_m,
            latitude_deg=HOME_LATITUDE_DEG + north_m / M_PER_DEG_LATITUDE,
            longitude_deg=HOME_LONGITUDE_DEG + east_m / _M_PER_DEG_LONGITUDE,
            track_deg=math.degrees(math.atan2(east, north)) % 360.0,
            airspeed_m_per_s=along * math.sqrt(density / atmosphere.SEA_LEVEL_DENSITY_KG_PER_M3),
            pitch_deg=fdm["attitude/theta-deg"],
            roll_deg=fdm["attitude/phi-deg"],
            pitch_rate_deg_per_s=pace * math.degrees(fdm["velocities/thetadot-rad_sec"]),
            roll_rate_deg_per_s=pace * math.degrees(fdm["velocities/phidot-rad_sec"]),
        )


def _still(_mechanism: str) -> float:
    return 0.0


def _as_number(device: str, value: Value) -> float:
    if not isinstance(value, (int, float)):
        raise TypeError(f"{device} needs a number as its command, not {value!r}")
    return float(value)
