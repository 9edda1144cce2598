"""What an observer of a simulated flight sees in the modules, which nothing on a bus shows: estimates and stages.

The observer reads the objects of modules that run. It changes none, so a flight is the same with and without it.
"""

from heronry_tools.fly.avionics.flight_management import FlightManagementSystem, Situation, Stage
from heronry_tools.fly.avionics.position import TrackedPosition
from heronry_tools.fly.avionics.tracking_filter import STATES, H, TrackingFilter, X, Y
from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.plant import Truth
from heronry_tools.sim.flight.simulation import Simulation

LABELS = {stage: stage.name.lower().replace("_", " ") for stage in Stage}


class Observer:
    """Looks into the flight management and the tracking filter, on whatever PE they run."""

    def __init__(self, simulation: Simulation, plant: EavPlant) -> None:
        self._simulation, self._plant = simulation, plant
        self.squares = [0.0] * STATES  # sums of the filter's errors over its own sigma, squared
        self.samples = 0

    def management(self) -> FlightManagementSystem | None:
        """Give the flight management that runs."""
        for pe in self._simulation.fleet.running.values():
            code = pe.code("flight_management")
            if isinstance(code, FlightManagementSystem):
                return code
        return None

    def tracking(self) -> TrackingFilter | None:
        """Give the filter that runs."""
        for pe in self._simulation.fleet.running.values():
            code = pe.code("tracked_position")
            if isinstance(code, TrackedPosition):
                return code.filter
        return None

    def columns(self) -> dict[str, float | None]:
        """Give the columns of the record that come from modules."""
        management, tracking = self.management(), self.tracking()
        known: Situation | None = None if management is None else management.known
        row: dict[str, float | None] = {
            "estimate_x_m": None if known is None else known.x_m,
            "estimate_y_m": None if known is None else known.y_m,
            "estimate_height_m": None if known is None else known.height_m,
        }
        for name, index in (("x_m", X), ("y_m", Y), ("height_m", H)):
            row[f"sigma_{name}"] = None if tracking is None else tracking.sigma(index)
        return row

    def stage(self) -> str | None:
        """Give the stage of the landing."""
        management = self.management()
        return None if management is None else LABELS[management.management.stage]

    def mode(self) -> str | None:
        """Give the mode of the flight management: what the plan could supply for the landing."""
        management = self.management()
        return None if management is None else management.ctx.mode

    def weigh(self, truth: Truth) -> None:
        """Compare every state of the filter with the truth, in units of its own sigma."""
        tracking = self.tracking()
        if tracking is None:
            return
        exact = truth.x_m, truth.y_m, truth.height_m, *self._plant.slow_errors()
        for i, value in enumerate(exact):
            variance = tracking.covariance[i][i]
            self.squares[i] += (tracking.state[i] - value) ** 2 / variance
        self.samples += 1
