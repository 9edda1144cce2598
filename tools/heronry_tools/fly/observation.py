"""Reads what modules of a simulated flight have estimated and decided, but do not publish on a bus.

The observer reads attributes of running modules and changes none. So a flight is the same with and without an observer.
"""

from heronry_tools.fly.avionics.flight_management import FlightManagementSystem, Situation, Stage
from heronry_tools.fly.avionics.position import TrackedPosition
from heronry_tools.fly.avionics.tracking_filter import STATES, H, TrackingFilter, X, Y
from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.plant import Truth
from heronry_tools.sim.flight.simulation import Simulation

LABELS = {stage: stage.name.lower().replace("_", " ") for stage in Stage}


class Observer:
    """Reads values from the running modules of flight management and tracking filter, whichever PE runs them."""

    def __init__(self, simulation: Simulation, plant: EavPlant) -> None:
        self._simulation, self._plant = simulation, plant
        self.squares = [0.0] * STATES  # for each state of the filter: sum of squared error over variance
        self.samples = 0

    def management(self) -> FlightManagementSystem | None:
        """Return the flight management that runs; None if no PE runs it."""
        for pe in self._simulation.fleet.running.values():
            code = pe.code("flight_management")
            if isinstance(code, FlightManagementSystem):
                return code
        return None

    def tracking(self) -> TrackingFilter | None:
        """Return the tracking filter that runs; None if no PE runs it."""
        for pe in self._simulation.fleet.running.values():
            code = pe.code("tracked_position")
            if isinstance(code, TrackedPosition):
                return code.filter
        return None

    def columns(self) -> dict[str, float | None]:
        """Return the estimated position and its standard deviations, in m; None for a value that is not known.

        The keys are names of columns in the record of a flight: `estimate_x_m`, `sigma_x_m` and so on.
        """
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
        """Return the stage of the landing; None if the flight management does not run."""
        management = self.management()
        return None if management is None else LABELS[management.management.stage]

    def mode(self) -> str | None:
        """Return the mode of the flight management; None if no PE runs the flight management.

        The planner selects the mode by the quality of the position that the plan can supply.
        """
        management = self.management()
        return None if management is None else management.ctx.mode

    def weigh(self, truth: Truth) -> None:
        """Add to `squares`, for each state of the filter, its squared error divided by its variance.

        The variance is the one that the filter itself gives. No effect while no PE runs the filter.
        """
        tracking = self.tracking()
        if tracking is None:
            return
        exact = truth.x_m, truth.y_m, truth.height_m, *self._plant.slow_errors()
        for i, value in enumerate(exact):
            variance = tracking.covariance[i][i]
            self.squares[i] += (tracking.state[i] - value) ** 2 / variance
        self.samples += 1
