"""Many landings of the EAV: the random choices of each, and the statistics of all."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random
from statistics import median
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.fly.acceptance import share, share_line
from heronry_tools.fly.mission import Blow, Landing, Mission

FIRST_BLOW_S, LAST_BLOW_S = 4.0, 34.0  # times of a drawn fault: on final, after the loss of the corrections


@dataclass(frozen=True, slots=True)
class Drawn:
    """Makes one mission for each seed.

    mission: the settings of all missions, except the seed
    one_fault: whether each mission gets one more fault, from `drawn_blow`
    """

    mission: Mission
    one_fault: bool = False

    def of(self, spec: Spec, seed: int) -> Mission:
        """Return the mission of a seed."""
        mission = replace(self.mission, seed=seed)
        if not self.one_fault:
            return mission
        return replace(mission, blows=(*mission.blows, drawn_blow(spec, seed)))


def drawn_blow(spec: Spec, seed: int) -> Blow:
    """Draw one fault at a random time: of a PE, of a wireless bus, or of an actuator (dead, stuck or loose)."""
    chance = Random(f"{seed} blow")
    servos = [f"device:{one.name}" for one in spec.devices.values() if one.kind == "actuator"]
    buses = [f"bus:{bus.name}" for bus in spec.buses.values() if bus.kind == "wireless"]
    pes = [f"pe:{pe}" for pe in spec.pes]
    element = chance.choice((chance.choice(pes), chance.choice(buses), chance.choice(servos)))
    how = chance.choice(("dead", "stuck", "loose")) if element.startswith("device:") else "dead"
    return Blow(element, at_s=chance.uniform(FIRST_BLOW_S, LAST_BLOW_S), how=how)


def summary(landings: Sequence[Landing]) -> dict[str, Any]:
    """Return the statistics of many landings as JSON data."""
    sinks = sorted(landing.touchdown.sink_m_per_s for landing in landings if landing.touchdown is not None)
    errors = [landing.worst_height_error_m for landing in landings if landing.worst_height_error_m is not None]
    after = sorted(one.reconfigured_after_s for one in landings if one.reconfigured_after_s is not None)
    filters = [landing.nees for landing in landings if landing.nees]
    return {
        **share([landing.causes for landing in landings]),
        "causes": dict(Counter(cause for landing in landings for cause in landing.causes).most_common()),
        "went_around": sum(landing.went_around for landing in landings),
        # landings at whose end the plan still supplied a position that is good enough to land
        "kept": share([landing.causes for landing in landings if landing.mode == "precise"]),
        "sink_m_per_s": quantiles(sinks, 0.95),
        "height_error_below_1_5_m": round(sum(e < 1.5 for e in errors) / len(errors), 4) if errors else None,
        "nees": [round(sum(column) / len(filters), 3) for column in zip(*filters, strict=True)],
        "reconfigured_after_s": quantiles(after, 0.99),
        "latency_s": quantiles(sorted(ns / 1e9 for one in landings for ns in one.latencies_ns), 0.99),
        "violations": sum(bool(landing.violations) for landing in landings),
    }


def quantiles(ordered: Sequence[float], high: float) -> list[float] | None:
    """Return the median and the quantile `high` (0 to 1) of rising numbers; None if there are no numbers."""
    if not ordered:
        return None
    return [round(median(ordered), 4), round(ordered[min(int(high * len(ordered)), len(ordered) - 1)], 4)]


def line(landing: Landing) -> str:
    """Return a line that says how a flight ended."""
    blows = "".join(f", {blow}" for blow in landing.mission.blows)
    head = f"seed {landing.mission.seed}{blows}: "
    landed = landing.touchdown
    if landed is None:
        how = "the landing is refused, and the aircraft goes around" if landing.went_around else "has not landed"
        return f"{head}{how}; digest {landing.digest}"
    judged = "acceptable" if not landing.causes else f"not acceptable ({', '.join(landing.causes)})"
    where = f"{landed.x_m:.1f} m from the aim, {landed.y_m:+.1f} m from the centre line"
    return f"{head}the landing is {judged}: {where}, sink {landed.sink_m_per_s:.2f} m/s; digest {landing.digest}"


def figures(found: dict[str, Any]) -> str:
    """Return text with the statistics that `summary` has made."""
    causes = ", ".join(f"{cause} {count}" for cause, count in found["causes"].items()) or "none"
    lines = [
        share_line(found),
        f"causes: {causes}; went around: {found['went_around']}",
    ]
    if found["sink_m_per_s"]:
        lines.append("sink rate: median {:.2f} m/s, 95 % below {:.2f} m/s".format(*found["sink_m_per_s"]))
    if found["height_error_below_1_5_m"] is not None:
        lines.append(
            f"below 10 m the error of the height stays below 1.5 m in {100 * found['height_error_below_1_5_m']:.1f} % "
            "of the landings"
        )
    if found["reconfigured_after_s"]:
        middle, most = found["reconfigured_after_s"]
        lines.append(f"reconfigured after a fault: median {middle:.3f} s, 99 % within {most:.3f} s")
    return "\n".join(lines)


def latency_line(found_s: Sequence[float]) -> str:
    """Return a line on the latency from sensor to servo.

    found_s: the median and the 99 % quantile of the latency, in s.
    """
    middle, most = (1000.0 * value for value in found_s)
    return f"from sensor to servo: median {middle:.1f} ms, 99 % within {most:.1f} ms"
