"""What one flight of the EAV is, all of it chosen before it begins, and what came of it."""

from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from heronry_tools.fly.acceptance import Cause, Touchdown, causes
from heronry_tools.fly.atmosphere import Wind
from heronry_tools.sim.faults.fault import Fault

STRONGEST_WIND_M_PER_S = 7.7  # of those that are drawn, at 20 ft
WIDEST_WIND_DEG = 60.0  # from the runway's direction


@dataclass(frozen=True, slots=True)
class Blow:
    """A fault at a time of the flight, or below a height: of `pe:NAME`, `bus:NAME`, or `device:NAME`.

    how: in which way a device fails (`heronry_tools.fly.plant.Failure`).
    """

    element: str
    at_s: float | None = None
    below_m: float | None = None
    how: str = "dead"

    def __str__(self) -> str:
        """Say it as on the command line."""
        when = f"{self.at_s:g}" if self.at_s is not None else f"{self.below_m:g}m"
        return f"{self.element}{'' if self.how == 'dead' else f'={self.how}'}@{when}"


@dataclass(frozen=True, slots=True)
class Mission:
    """A flight of the EAV on final.

    corrections_lost_s: when the differential receiver loses its accuracy; None: never. acts: faults of
    the simulator, with times from the begin of the flight. `judged`: what the oracles of the simulator find is told.
    probed: the latency from sensor to servo is measured, in still air and with sensors without errors.
    """

    seed: int = 0
    strongest_wind_m_per_s: float = STRONGEST_WIND_M_PER_S
    corrections_lost_s: float | None = 2.0
    has_rover: bool = True
    must_land: bool = False
    blows: tuple[Blow, ...] = ()
    acts: tuple[Fault, ...] = ()
    most_height_bias_m: float = 0.0  # of the differential receiver: a constant error that is drawn, and not found
    judged: bool = False
    probed: bool = False
    longest_s: float = 90.0

    def height_bias_m(self) -> float:
        """Give the constant error of the receiver's height that the seed draws."""
        return Random(f"{self.seed} height bias").uniform(-self.most_height_bias_m, self.most_height_bias_m)

    def wind(self) -> Wind:
        """Give the wind that the seed draws."""
        chance = Random(f"{self.seed} wind")
        return Wind(chance.uniform(0.0, self.strongest_wind_m_per_s), chance.uniform(-WIDEST_WIND_DEG, WIDEST_WIND_DEG))


@dataclass(frozen=True, slots=True)
class Landing:
    """What came of a mission.

    mode: that of the flight management at the end, None where it does not run. digest: of every frame and of the
    aircraft at the end. reconfigured_after_s: from the first blow to the next active configuration; None without one.
    worst_height_error_m: of the height that steers, below 10 m. nees: of each state of the tracking filter, its mean
    squared error in units of its own variance; empty where no filter ran. violations: of the oracles.
    latencies_ns: from sensor to servo, of a probed mission.
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
        """Why the landing is not acceptable; empty if it is."""
        return causes(self.touchdown)

    @property
    def height_bias_m(self) -> float | None:
        """Constant error of the height by which it landed, where one was drawn."""
        return self.mission.height_bias_m() if self.mission.most_height_bias_m else None

    def document(self) -> dict[str, Any]:
        """Give it as plain data for JSON."""
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
