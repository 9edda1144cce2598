"""Sets the wind and the gusts of `atmosphere` in JSBSim."""

from heronry_tools.fly.atmosphere import Air, Wind
from heronry_tools.fly.dynamics.model import M_PER_FT, Model
from heronry_tools.fly.plant import STEPS_PER_S


class MovingAir:
    """The air of one flight; equal seeds and equal heights give equal air."""

    def __init__(self, seed: int, wind: Wind) -> None:
        self._air = Air(seed, wind)

    def begin(self, model: Model) -> None:
        """Switch JSBSim's own turbulence off.

        This turbulence has no effect below 1 000 ft, and its random numbers do not come from the flight's seed.
        """
        model.put("atmosphere/turb-type", 0)

    def step(self, model: Model, height_m: float) -> None:
        """Set the velocity of the air at the aircraft, for one step of the plant."""
        fdm = model.fdm
        north, east, down = self._air.step(
            1.0 / STEPS_PER_S, height_m, fdm["velocities/vt-fps"] * M_PER_FT, fdm["attitude/psi-rad"]
        )
        fdm["atmosphere/wind-north-fps"] = north / M_PER_FT
        fdm["atmosphere/wind-east-fps"] = east / M_PER_FT
        fdm["atmosphere/wind-down-fps"] = down / M_PER_FT
