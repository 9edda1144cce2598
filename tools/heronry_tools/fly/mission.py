"""What one flight of the EAV is: its seed, its wind, and what happens to it; all of it chosen before it begins."""

from dataclasses import dataclass
from random import Random

from heronry_tools.fly.atmosphere import Wind

STRONGEST_WIND_M_PER_S = 7.7  # of those that are drawn, at 20 ft
WIDEST_WIND_DEG = 60.0  # from the runway's direction


@dataclass(frozen=True, slots=True)
class Blow:
    """A fault at a time of the flight, or below a height: `pe:NAME`, `bus:NAME`, or `device:NAME` with its way."""

    element: str
    at_s: float | None = None
    below_m: float | None = None
    how: str = "dead"

    def __str__(self) -> str:
        """Say it as on the command line."""
        when = f"{self.at_s:g}" if self.at_s is not None else f"below {self.below_m:g} m"
        return f"{self.element}@{when}"


@dataclass(frozen=True, slots=True)
class Mission:
    """A flight of the EAV on final.

    corrections_lost_s: when the differential receiver loses its accuracy; None: never. limits: shares of bus capacity
    (`radio` 0.1) that the manager is told of at the start. judged: the oracles of the simulator look on.
    """

    seed: int = 0
    strongest_wind_m_per_s: float = STRONGEST_WIND_M_PER_S
    corrections_lost_s: float | None = 2.0
    has_rover: bool = True
    must_land: bool = False
    blows: tuple[Blow, ...] = ()
    judged: bool = False
    longest_s: float = 90.0

    def wind(self) -> Wind:
        """Give the wind that the seed draws."""
        chance = Random(f"{self.seed} wind")
        return Wind(
            chance.uniform(0.0, self.strongest_wind_m_per_s), chance.uniform(-WIDEST_WIND_DEG, WIDEST_WIND_DEG)
        )
