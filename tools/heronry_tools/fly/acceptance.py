"""Whether a landing is acceptable, and how sure a share of acceptable landings is.

What counts is the state of the aircraft at the first contact with the ground, and what touches the ground from then
on. Each criterion that is not met is one cause; a landing without a cause is acceptable. The limits stand
here alone: tests, dispersion and reports ask this file.

The interval of a share is Wilson's, which is right for shares near 0 and 1 as well, where the usual normal
approximation is not (E. B. Wilson, 1927; A. Agresti and B. Coull, 1998).
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
    """The EAV's landing: on a runway 14.4 m wide, on its wheels; x from the aim, y from the centre line."""

    sink_m_per_s: float = 1.5
    offset_m: float = 7.2
    along_m: tuple[float, float] = (-60.0, 90.0)
    bank_deg: float = 10.0
    pitch_deg: tuple[float, float] = (0.0, 14.0)


@dataclass(frozen=True, slots=True)
class Field:
    """BIG BLUE's landing: anywhere near home, slowly enough for its skids."""

    distance_m: float = 500.0
    sink_m_per_s: float = 3.0


RUNWAY, FIELD = Runway(), Field()
Site = Literal["runway", "field"]

_Z_95 = 1.959963984540054  # of a normal distribution, 95 % lie within so many standard deviations


@dataclass(frozen=True, slots=True)
class Touchdown:
    """The aircraft at its first contact with the ground, in the runway's frame (see `plant`); sink is positive down.

    `structure`: the contacts other than wheels that have touched the ground, then or later in the record.
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
    """Give the criteria that a landing does not meet, in the order of `CAUSES`; none: it is acceptable.

    None: the aircraft has not touched the ground within its flight.
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
    """Give the 95 % interval of a share, 0..1, of `acceptable` among `runs`; without a run, everything from 0 to 1."""
    if runs == 0:
        return 0.0, 1.0
    share, z2 = acceptable / runs, _Z_95 * _Z_95
    middle = (share + z2 / (2 * runs)) / (1 + z2 / runs)
    half = _Z_95 / (1 + z2 / runs) * math.sqrt(share * (1 - share) / runs + z2 / (4 * runs * runs))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def share(landings: Sequence[Collection[Cause]]) -> dict[str, Any]:
    """Give number, acceptable number and interval of landings as plain data; each landing is its unmet criteria."""
    acceptable = sum(not unmet for unmet in landings)
    low, high = interval(acceptable, len(landings))
    return {"runs": len(landings), "acceptable": acceptable, "interval": [round(low, 4), round(high, 4)]}


def share_line(found: Mapping[str, Any]) -> str:
    """Say what `share` gives of at least one landing."""
    low, high = found["interval"]
    percent = 100 * found["acceptable"] / found["runs"]
    return (
        f"{found['acceptable']} of {found['runs']} landings are acceptable "
        f"({percent:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f})"
    )
