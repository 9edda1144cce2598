"""The settings of one flight of BIG BLUE, and its result."""

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
_STREAM_M_PER_S = 12.0  # strongest drawn wind at the height of the jet stream; a day with more is not a day to fly


@dataclass(frozen=True, slots=True)
class GliderMission:
    """The settings of a flight, from one of the starts of `dynamics.big_blue` to the ground.

    strongest_wind_m_per_s: upper limit of the wind at 20 ft that the seed draws
    pace: while the aircraft hangs on its line, the plant's time passes this many times faster than the avionics' clock
    blows: faults that are injected at a time of the flight or below a height
    acts: faults of the kinds of `heronry sim`; their times count from the beginning of the flight
    `judged`: whether the simulator's oracles check the flight; `GliderLanding.violations` has what they find
    longest_s: time of the flight at which it ends if there was no touchdown before
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
        """Return the wind that the seed draws; it comes roughly from the west.

        Below 1 000 ft its direction differs from west by up to 60 degrees; at 9 000 m and above, by up to 20.
        """
        chance = Random(f"{self.seed} wind")
        speed, from_deg = chance.uniform(0.0, self.strongest_wind_m_per_s), chance.uniform(210.0, 330.0)
        stream_deg = chance.uniform(250.0, 290.0)
        aloft = ((9_000.0, chance.uniform(4.0, _STREAM_M_PER_S), stream_deg), (20_000.0, 8.0, stream_deg))
        return Wind(speed, from_deg, aloft)


@dataclass(frozen=True, slots=True)
class GliderLanding:
    """The result of a flight.

    touchdown: state at the first contact with the ground; None if there was none
    phases: phases that the manager entered, each with its time in s on the avionics' clock
    guided: whether the last plan has modules that steer by the route
    chute: whether the parachute opened
    released_m: height at which the line was cut; None if it was not cut
    flown_s: duration of the flight on the avionics' clock
    world_s: duration of the flight in the plant's time, which passes faster while the aircraft hangs on the line
    digest: digest of every frame and of the state at the end
    violations: what the simulator's oracles found
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
        """Return the criteria that the landing does not meet; empty for an acceptable landing."""
        return causes(self.touchdown, "field")

    @property
    def from_home_m(self) -> float | None:
        """Return the distance of the touchdown from home; None without a touchdown."""
        return None if self.touchdown is None else math.hypot(self.touchdown.x_m, self.touchdown.y_m)

    def document(self) -> dict[str, Any]:
        """Return the result as JSON data."""
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
    """Draw one fault, 5 to 400 s after the beginning of the flight: a PE fails, or a device is dead or stuck."""
    chance = Random(f"{seed} blow")
    pe, device = chance.choice(list(spec.pes)), chance.choice(list(spec.devices))
    element = chance.choice((f"pe:{pe}", f"device:{device}"))
    how = chance.choice(("dead", "stuck")) if element.startswith("device:") else "dead"
    return Blow(element, at_s=chance.uniform(_FIRST_BLOW_S, _LAST_BLOW_S), how=how)
