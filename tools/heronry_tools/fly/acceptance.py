"""Whether a landing is acceptable, and the confidence interval of the share of acceptable landings.

A landing is assessed by two things: the state of the aircraft at its first contact with the ground, and the parts of
the aircraft that touch the ground at this time or later. Each criterion that the landing does not meet is a *cause*. A
landing without a cause is acceptable. No other file states the limits: tests, campaigns and reports import them.

The confidence interval is Wilson's. Unlike the usual normal approximation, it is also right for shares near 0 and 1
(E. B. Wilson, 1927; A. Agresti and B. Coull, 1998).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Cause = Literal["sink", "offset", "short", "long", "far", "bank", "nose low", "nose high", "structure", "not landed"]
CAUSES: tuple[Cause, ...] = (
    "not landed", "structure", "sink", "far", "offset", "short", "long", "bank", "nose low", "nose high",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Runway:
    """Limits for a landing of the EAV on its wheels, on a runway 14.4 m wide.

    sink_m_per_s: greatest sink rate
    offset_m: greatest distance from the centre line
    along_m: least and greatest x of the touchdown; x is the distance along the runway beyond the aiming point
    bank_deg: greatest angle of bank, to either side
    pitch_deg: least and greatest pitch angle
    """

    sink_m_per_s: float = 1.5
    offset_m: float = 7.2
    along_m: tuple[float, float] = (-60.0, 90.0)
    bank_deg: float = 10.0
    pitch_deg: tuple[float, float] = (0.0, 14.0)


@dataclass(frozen=True, slots=True)
class Field:
    """Limits for a landing of BIG BLUE on its skids, near home.

    distance_m: greatest distance from home
    sink_m_per_s: greatest sink rate
    """

    distance_m: float = 500.0
    sink_m_per_s: float = 3.0


RUNWAY, FIELD = Runway(), Field()
Site = Literal["runway", "field"]

_Z_95 = 1.959963984540054  # 95 % of a normal distribution lie within so many standard deviations of its mean


@dataclass(frozen=True, slots=True)
class Touchdown:
    """The aircraft at its first contact with the ground; positions are in the frame of `heronry_tools.fly.plant`.

    sink_m_per_s: sink rate, positive downwards
    structure: names of the parts, other than wheels and skids, that touched the ground at this time or later
    """

    time_s: float
    x_m: float
    y_m: float
    sink_m_per_s: float
    bank_deg: float
    pitch_deg: float
    airspeed_m_per_s: float
    structure: tuple[str, ...] = ()


def causes(touchdown: Touchdown | None, site: Site = "runway") -> tuple[Cause, ...]:
    """Return the criteria that a landing does not meet, in the order of `CAUSES`; empty for an acceptable landing.

    A `touchdown` of None means that the aircraft did not touch the ground before the flight ended.
    """
    if touchdown is None:
        return ("not landed",)
    unmet = _unmet_on_runway(touchdown) if site == "runway" else _unmet_on_field(touchdown)
    return tuple(cause for cause in CAUSES if unmet.get(cause))


def _unmet_on_runway(touchdown: Touchdown) -> dict[Cause, bool]:
    return {
        "structure": bool(touchdown.structure),
        "sink": touchdown.sink_m_per_s > RUNWAY.sink_m_per_s,
        "offset": abs(touchdown.y_m) > RUNWAY.offset_m,
        "short": touchdown.x_m < RUNWAY.along_m[0],
        "long": touchdown.x_m > RUNWAY.along_m[1],
        "bank": abs(touchdown.bank_deg) > RUNWAY.bank_deg,
        "nose low": touchdown.pitch_deg < RUNWAY.pitch_deg[0],
        "nose high": touchdown.pitch_deg > RUNWAY.pitch_deg[1],
    }


def _unmet_on_field(touchdown: Touchdown) -> dict[Cause, bool]:
    return {
        "structure": bool(touchdown.structure),
        "sink": touchdown.sink_m_per_s > FIELD.sink_m_per_s,
        "far": math.hypot(touchdown.x_m, touchdown.y_m) > FIELD.distance_m,
    }


def interval(acceptable: int, runs: int) -> tuple[float, float]:
    """Return both ends of the 95 % interval of the share `acceptable / runs`; (0, 1) if `runs` is 0."""
    if runs == 0:
        return 0.0, 1.0
    share, z2 = acceptable / runs, _Z_95 * _Z_95
    middle = (share + z2 / (2 * runs)) / (1 + z2 / runs)
    half = _Z_95 / (1 + z2 / runs) * math.sqrt(share * (1 - share) / runs + z2 / (4 * runs * runs))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def share(landings: Sequence[Collection[Cause]]) -> dict[str, Any]:
    """Count all landings and the acceptable ones; returns JSON data.

    The result also has the 95 % interval of the share of acceptable landings, as two numbers from 0 to 1.

    landings: for each landing, the criteria that it does not meet.
    """
    acceptable = sum(not unmet for unmet in landings)
    low, high = interval(acceptable, len(landings))
    return {"runs": len(landings), "acceptable": acceptable, "interval": [round(low, 4), round(high, 4)]}


def share_line(found: Mapping[str, Any]) -> str:
    """Put the result of `share` into a sentence; there must be at least one landing."""
    low, high = found["interval"]
    percent = 100 * found["acceptable"] / found["runs"]
    return (
        f"{found['acceptable']} of {found['runs']} landings are acceptable "
        f"({percent:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f})"
    )
