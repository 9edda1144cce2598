"""Loads an aircraft into JSBSim, and converts the units of JSBSim.

JSBSim prints a banner, unless `JSBSIM_DEBUG` is 0 in the environment before the first object of JSBSim is made; `Model`
sets this variable. JSBSim accepts misspelt properties without a message, so `Model.put` checks that a property exists
before it is written.

In JSBSim, the force of a wheel is the force of its spring, divided by the squared cosine of the aircraft's tilt. When
the aircraft lies on its side, this force has no limit: in one step the aircraft would get a speed of thousands of
metres per second, and soon its whole state would be NaN. Therefore `Model.step` retracts the wheels beyond a tilt of 60
degrees, and the aircraft lies on its structure. For this, all wheels and skids in an aircraft file must be
`retractable`.
"""

import math
import os
from pathlib import Path
from typing import Any, Protocol

from heronry_tools.console.errors import UserError
from heronry_tools.fly.plant import STEPS_PER_S

M_PER_FT = 0.3048
_MODELS = Path(__file__).parent / "models"
# WGS 84 at the equator, where the runway lies: metres per radian of latitude and of longitude
_M_PER_RAD_NORTH = 6_335_439.3
_M_PER_RAD_EAST = 6_378_137.0
_LEAST_COSINE = 0.5  # least cosine of the tilt at which the wheels carry
_FASTEST_M_PER_S = 1_000.0  # a model that is faster has diverged


class Air(Protocol):
    """The moving air around an aircraft."""

    def begin(self, model: "Model") -> None:
        """Prepare wind and turbulence, before the first step."""

    def step(self, model: "Model", height_m: float) -> None:
        """Set the wind at the aircraft for the next step; call this before each step.

        height_m: height of the aircraft above the ground.
        """


class Model:
    """One aircraft in JSBSim; quantities are in SI units and degrees unless a name says otherwise."""

    def __init__(self, aircraft: str, *, seed: int, models: Path = _MODELS) -> None:
        """Load the file `models`/aircraft/NAME/NAME.xml, where NAME is `aircraft`.

        Raises UserError if JSBSim is not installed, or cannot load the file.
        """
        os.environ.setdefault("JSBSIM_DEBUG", "0")
        try:
            import jsbsim  # noqa: PLC0415 - only a flight in the model needs it
        except ImportError:
            raise UserError(
                'flights need JSBSim, which is not installed; add it with: pip install "heronry[manager,fly]"'
            ) from None
        self.fdm: Any = jsbsim.FGFDMExec(None)
        self.fdm.set_debug_level(0)
        self.fdm.set_aircraft_path(str(models / "aircraft"))
        self.fdm.set_engine_path(str(models / "engine"))
        self.fdm.set_systems_path(str(models))
        if not self.fdm.load_model(aircraft):
            raise UserError(
                f"JSBSim cannot load the aircraft '{aircraft}' from the folder {models}; install heronry again, or "
                "undo your changes in this folder"
            )
        self.fdm.set_dt(1.0 / STEPS_PER_S)
        self.fdm["simulation/randomseed"] = seed % 2**31
        self._aircraft, self._seed = aircraft, seed
        self._wheels_carry = True
        self._has_diverged = False

    def put(self, name: str, value: float) -> None:
        """Set a property of JSBSim; raises KeyError if JSBSim does not have it."""
        self.fdm[name]  # raises KeyError; the next line alone would create the property
        self.fdm[name] = value

    def start(self, *, north_m: float, east_m: float, up_m: float, airspeed_m_per_s: float, heading_deg: float) -> None:
        """Place the aircraft in level flight with its engine running; the aircraft is not trimmed yet.

        up_m: height of the centre of gravity above the runway.
        Raises UserError if JSBSim does not accept these initial conditions.
        """
        fdm = self.fdm
        fdm["ic/lat-geod-deg"] = math.degrees(north_m / _M_PER_RAD_NORTH)
        fdm["ic/long-gc-deg"] = math.degrees(east_m / _M_PER_RAD_EAST)
        fdm["ic/terrain-elevation-ft"] = 0.0
        fdm["ic/h-sl-ft"] = up_m / M_PER_FT
        fdm["ic/psi-true-deg"] = heading_deg
        fdm["ic/gamma-deg"] = 0.0
        fdm["ic/vt-fps"] = airspeed_m_per_s / M_PER_FT
        if not fdm.run_ic():
            raise UserError(
                f"JSBSim cannot start '{self._aircraft}' at {up_m:g} m above the runway with {airspeed_m_per_s:g} m/s; "
                f"install heronry again, or undo your changes in {self._aircraft}.xml"
            )
        fdm["propulsion/engine[0]/set-running"] = 1

    def step(self) -> None:
        """Advance JSBSim by one step.

        Raises UserError if the model has diverged; from then on each step raises it.
        """
        fdm = self.fdm
        is_upright = math.cos(fdm["attitude/phi-rad"]) * math.cos(fdm["attitude/theta-rad"]) > _LEAST_COSINE
        if is_upright != self._wheels_carry:
            self._wheels_carry = is_upright
            fdm["gear/gear-pos-norm"] = 1.0 if is_upright else 0.0
        fdm.run()
        if self._has_diverged or not fdm["velocities/vt-fps"] * M_PER_FT < _FASTEST_M_PER_S:  # true for NaN, too
            self._has_diverged = True
            raise UserError(
                f"the flight model of '{self._aircraft}' has diverged (seed {self._seed}, after "
                f"{fdm['simulation/sim-time-sec']:.2f} s): its speed is no longer below {_FASTEST_M_PER_S:.0f} m/s; "
                f"look in {self._aircraft}.xml for forces without a limit, and at the commands to the actuators before "
                "that time"
            )

    def position_m(self) -> tuple[float, float, float]:
        """Return the position of the centre of gravity, in m from the runway's aiming point: to north, to east, up."""
        fdm = self.fdm
        return (
            fdm["position/lat-geod-rad"] * _M_PER_RAD_NORTH,
            fdm["position/long-gc-rad"] * _M_PER_RAD_EAST,
            fdm["position/h-agl-ft"] * M_PER_FT,
        )
