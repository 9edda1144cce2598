"""The settings of one flight of the EAV, all chosen before it begins, and its result."""

from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from heronry_tools.fly.acceptance import Cause, Touchdown, causes
from heronry_tools.fly.atmosphere import Wind
from heronry_tools.sim.faults.fault import Fault

STRONGEST_WIND_M_PER_S = 7.7  # strongest drawn wind, at 20 ft
WIDEST_WIND_DEG = 60.0  # from the runway's direction


@dataclass(frozen=True, slots=True)
class Blow:
    """One fault, which is injected at a time of the flight or below a height.

    element: what fails: `pe:NAME`, `bus:NAME` or `device:NAME`
    at_s: time of the flight; None if the height decides
    below_m: height of the wheels above the runway; None if the time decides
    how: the way in which a device fails, see `heronry_tools.aircraft.plant.interface.Failure`
    """

    element: str
    at_s: float | None = None
    below_m: float | None = None
    how: str = "dead"

    def __str__(self) -> str:
        """Return the fault as it is written on the command line."""
        when = f"{self.at_s:g}" if self.at_s is not None else f"{self.below_m:g}m"
        return f"{self.element}{'' if self.how == 'dead' else f'={self.how}'}@{when}"


@dataclass(frozen=True, slots=True)
class Mission:
    """The settings of a flight of the EAV on final approach.

    strongest_wind_m_per_s: upper limit of the wind at 20 ft; the seed draws the wind
    corrections_lost_s: time of the flight from which the differential receiver is inaccurate; None: it never is
    has_rover: whether the rover is beside the runway
    must_land: whether the operator orders to land even without a good position
    blows: faults that are injected at a time of the flight or below a height
    acts: faults of the kinds of `heronry sim`; their times count from the beginning of the flight
    most_height_bias_m: upper limit of the constant height error of the differential receiver; the seed draws the error
    `judged`: whether the simulator's oracles check the flight; `Landing.violations` has what they find
    probed: whether latencies from sensor to servo are measured; the air is then still, and only the camera has errors
    longest_s: time of the flight; if there is no touchdown before it, the flight ends at this time
    """

    seed: int = 0
    strongest_wind_m_per_s: float = STRONGEST_WIND_M_PER_S
    corrections_lost_s: float | None = 2.0
    has_rover: bool = True
    must_land: bool = False
    blows: tuple[Blow, ...] = ()
    acts: tuple[Fault, ...] = ()
    most_height_bias_m: float = 0.0  # no monitor detects this error, since it is constant
    judged: bool = False
    probed: bool = False
    longest_s: float = 90.0

    def height_bias_m(self) -> float:
        """Return the constant error of the receiver's height that the seed draws."""
        return Random(f"{self.seed} height bias").uniform(-self.most_height_bias_m, self.most_height_bias_m)

    def wind(self) -> Wind:
        """Return the wind that the seed draws."""
        chance = Random(f"{self.seed} wind")
        return Wind(chance.uniform(0.0, self.strongest_wind_m_per_s), chance.uniform(-WIDEST_WIND_DEG, WIDEST_WIND_DEG))


@dataclass(frozen=True, slots=True)
class Landing:
    """The result of a flight.

    touchdown: state at the first contact with the ground; None if there was none
    mode: mode of the flight management at the end; None if no PE runs the flight management
    digest: one digest of all frames and of the state at the end
    reconfigured_after_s: time from the first fault to the next active configuration; None if there was no fault, or no
        configuration became active after it
    worst_height_error_m: greatest error of the estimated height while the aircraft was below 10 m and had not touched
        the ground; None if there was no estimate in this time
    nees: for each state of the tracking filter, the mean over time of (squared error / variance); empty without a
        filter
    violations: what the simulator's oracles found
    latencies_ns: measured latencies from sensor to servo; empty if the mission is not `probed`
    """

    mission: Mission
    touchdown: Touchdown | None
    went_around: bool
    mode: str | None
    digest: str
    flown_s: float
    reconfigured_after_s: float | None
    worst_height_error_m: float | None
    nees: tuple[float, ...]
    violations: tuple[str, ...]
    latencies_ns: tuple[int, ...] = ()

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Return the criteria that the landing does not meet; empty for an acceptable landing."""
        return causes(self.touchdown)

    @property
    def height_bias_m(self) -> float | None:
        """Return the drawn constant error of the differential receiver's height; None if none was drawn."""
        return self.mission.height_bias_m() if self.mission.most_height_bias_m else None

    def document(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        landed = self.touchdown
        return {
            "seed": self.mission.seed,
            "acceptable": not self.causes,
            "causes": list(self.causes),
            "went_around": self.went_around,
            "mode": self.mode,
            "height_bias_m": self.height_bias_m,
            "blows": [str(blow) for blow in self.mission.blows],
            "touchdown": None if landed is None else asdict(landed),
            "reconfigured_after_s": self.reconfigured_after_s,
            "worst_height_error_m": self.worst_height_error_m,
            "nees": list(self.nees),
            "flown_s": self.flown_s,
            "digest": self.digest,
            "violations": list(self.violations),
            "latencies_ns": list(self.latencies_ns),
        }
