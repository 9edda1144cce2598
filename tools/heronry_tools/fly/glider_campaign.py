"""Many flights of BIG BLUE: the mission of each seed, and the statistics of all flights together."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.fly.acceptance import share, share_line
from heronry_tools.fly.glider_mission import GliderLanding, GliderMission, drawn_blow


def missions(spec: Spec, first: GliderMission, runs: int, *, one_fault: bool) -> list[GliderMission]:
    """Return `runs` missions that differ from `first` in their seeds, which count up from that of `first`.

    If `one_fault` is True, each mission also gets one random fault.
    """
    found = [replace(first, seed=seed) for seed in range(first.seed, first.seed + runs)]
    if not one_fault:
        return found
    return [replace(mission, blows=(*mission.blows, drawn_blow(spec, mission.seed))) for mission in found]


def summary(landings: Sequence[GliderLanding]) -> dict[str, Any]:
    """Return the statistics of many flights as JSON data.

    The entry `kept` has the share of acceptable landings among the flights in which no parachute opened, and whose last
    plan has modules that steer by the route. The entry `from_home_m` has the median and the greatest distance of the
    landings from home, in m.
    """
    kept = [landing for landing in landings if landing.guided and not landing.chute]
    far = sorted(landing.from_home_m for landing in landings if landing.from_home_m is not None)
    return {
        **share([landing.causes for landing in landings]),
        "causes": dict(Counter(cause for landing in landings for cause in landing.causes).most_common()),
        "kept": share([landing.causes for landing in kept]),
        "chutes": sum(landing.chute for landing in landings),
        "from_home_m": [round(median(far), 1), round(far[-1], 1)] if far else None,
        "violations": sum(bool(landing.violations) for landing in landings),
    }


def line(landing: GliderLanding) -> str:
    """Return a line that says how a flight ended."""
    blows = "".join(f", {blow}" for blow in landing.mission.blows)
    head = f"seed {landing.mission.seed}{blows}: "
    touched = landing.touchdown
    if touched is None:
        return f"{head}has not landed after {landing.flown_s:.0f} s; digest {landing.digest}"
    judged = "acceptable" if not landing.causes else f"not acceptable ({', '.join(landing.causes)})"
    under = " under the parachute" if landing.chute else ""
    phases = " ".join(f"{phase} from {time_s:.0f} s" for phase, time_s in landing.phases)
    return (
        f"{head}the landing{under} is {judged}: {landing.from_home_m:.0f} m from home, sink "
        f"{touched.sink_m_per_s:.2f} m/s, after {landing.flown_s:.0f} s on board ({landing.world_s:.0f} s of the "
        f"plant's time); phases: {phases}; digest {landing.digest}"
    )


def figures(found: dict[str, Any]) -> str:
    """Return text with the statistics that `summary` has made."""
    causes = ", ".join(f"{cause} {count}" for cause, count in found["causes"].items()) or "none"
    kept = found["kept"]
    return (
        f"{share_line(found)}\n"
        f"causes: {causes}; under the parachute: {found['chutes']}\n"
        f"of {kept['runs']} flights whose guidance was kept, {kept['acceptable']} land within 500 m of home"
    )
