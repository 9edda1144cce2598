"""What one flight of BIG BLUE is, and what came of it."""

import math
from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.fly.acceptance import Cause, Touchdown, causes
from heronry_tools.fly.atmosphere import Wind
from heronry_tools.fly.dynamics.big_blue import Start
from heronry_tools.fly.mission import Blow
from heronry_tools.sim.faults.fault import Fault

STRONGEST_WIND_M_PER_S = 5.0  # at 20 ft
PACE = 30
_FIRST_BLOW_S, _LAST_BLOW_S = 5.0, 400.0
_STREAM_M_PER_S = 12.0  # at the height of the jet stream: a day on which such a flight is tried


@dataclass(frozen=True, slots=True)
class GliderMission:
    """A flight from one of the starts of `dynamics.big_blue` to the ground.

    pace: how much faster than the avionics' clock time passes on the balloon's line. acts: faults of `heronry sim`, by
    the time of the flight. `judged`: what the oracles of the simulator find is told.
    """

    seed: int = 0
    start: Start = "ascent"
    strongest_wind_m_per_s: float = STRONGEST_WIND_M_PER_S
    pace: int = PACE
    blows: tuple[Blow, ...] = ()
    acts: tuple[Fault, ...] = ()
    judged: bool = False
    longest_s: float = 9_000.0

    def wind(self) -> Wind:
        """Give the wind that the seed draws: from the west aloft, from anywhere near it on the ground."""
        chance = Random(f"{self.seed} wind")
        speed, from_deg = chance.uniform(0.0, self.strongest_wind_m_per_s), chance.uniform(210.0, 330.0)
        stream_deg = chance.uniform(250.0, 290.0)
        aloft = ((9_000.0, chance.uniform(4.0, _STREAM_M_PER_S), stream_deg), (20_000.0, 8.0, stream_deg))
        return Wind(speed, from_deg, aloft)


@dataclass(frozen=True, slots=True)
class GliderLanding:
    """What came of a flight.

    phases: when the manager entered each, in s of the avionics' clock. guided: the last plan steers by the route.
    chute: the parachute was opened. released_m: the height at which the line was cut; None if it was not.
    world_s: the time that has passed in the world; flown_s: on the avionics' clock.
    """

    mission: GliderMission
    touchdown: Touchdown | None
    phases: tuple[tuple[str, float], ...]
    guided: bool
    chute: bool
    released_m: float | None
    flown_s: float
    world_s: float
    digest: str
    violations: tuple[str, ...]

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Why the landing is not acceptable; empty if it is."""
        return causes(self.touchdown, "field")

    @property
    def from_home_m(self) -> float | None:
        """Distance of the touchdown from home."""
        return None if self.touchdown is None else math.hypot(self.touchdown.x_m, self.touchdown.y_m)

    def document(self) -> dict[str, Any]:
        """Give it as plain data for JSON."""
        return {
            "seed": self.mission.seed,
            "acceptable": not self.causes,
            "causes": list(self.causes),
            "from_home_m": self.from_home_m,
            "phases": dict(self.phases),
            "guided": self.guided,
            "chute": self.chute,
            "released_m": self.released_m,
            "blows": [str(blow) for blow in self.mission.blows],
            "touchdown": None if self.touchdown is None else asdict(self.touchdown),
            "flown_s": self.flown_s,
            "world_s": self.world_s,
            "digest": self.digest,
            "violations": list(self.violations),
        }


def drawn_blow(spec: Spec, seed: int) -> Blow:
    """Draw one fault of a flight from the release on: a PE, or a device that dies or sticks."""
    chance = Random(f"{seed} blow")
    pe, device = chance.choice(list(spec.pes)), chance.choice(list(spec.devices))
    element = chance.choice((f"pe:{pe}", f"device:{device}"))
    how = chance.choice(("dead", "stuck")) if element.startswith("device:") else "dead"
    return Blow(element, at_s=chance.uniform(_FIRST_BLOW_S, _LAST_BLOW_S), how=how)
