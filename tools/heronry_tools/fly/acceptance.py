"""Whether a landing is acceptable, and how sure a share of acceptable landings is.

A landing is judged by the state of the aircraft at the first contact with the ground, and by what touches the ground
from then on. Each criterion that is not met is one cause; a landing without a cause is acceptable. The limits stand
here alone: tests, dispersion and reports ask this file.

The interval of a share is Wilson's, which is right for shares near 0 and 1 as well, where the usual normal
approximation is not (E. B. Wilson, 1927; A. Agresti and B. Coull, 1998).
"""

import math
from dataclasses import dataclass
from typing import Literal

LARGEST_SINK_M_PER_S = 1.5
LARGEST_OFFSET_M = 7.2  # from the centre line: half of a runway 14.4 m wide
SHORTEST_M, LONGEST_M = -60.0, 90.0  # along the runway from the aim
LARGEST_BANK_DEG = 10.0
LEAST_PITCH_DEG, LARGEST_PITCH_DEG = 0.0, 14.0

Cause = Literal["sink", "offset", "short", "long", "bank", "nose low", "nose high", "structure", "not landed"]
CAUSES: tuple[Cause, ...] = (
    "not landed", "structure", "sink", "offset", "short", "long", "bank", "nose low", "nose high",
)  # fmt: skip

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


def causes(touchdown: Touchdown | None) -> tuple[Cause, ...]:
    """Give the criteria that a landing does not meet, in the order of `CAUSES`; none: it is acceptable.

    None: the aircraft has not touched the ground within its flight.
    """
    if touchdown is None:
        return ("not landed",)
    unmet: dict[Cause, bool] = {
        "structure": bool(touchdown.structure),
        "sink": touchdown.sink_m_per_s > LARGEST_SINK_M_PER_S,
        "offset": abs(touchdown.y_m) > LARGEST_OFFSET_M,
        "short": touchdown.x_m < SHORTEST_M,
        "long": touchdown.x_m > LONGEST_M,
        "bank": abs(touchdown.bank_deg) > LARGEST_BANK_DEG,
        "nose low": touchdown.pitch_deg < LEAST_PITCH_DEG,
        "nose high": touchdown.pitch_deg > LARGEST_PITCH_DEG,
    }
    return tuple(cause for cause, is_unmet in unmet.items() if is_unmet)


def interval(acceptable: int, runs: int) -> tuple[float, float]:
    """Give the 95 % interval of a share, 0..1, of `acceptable` among `runs`; without a run, everything from 0 to 1."""
    if runs == 0:
        return 0.0, 1.0
    share, z2 = acceptable / runs, _Z_95 * _Z_95
    middle = (share + z2 / (2 * runs)) / (1 + z2 / runs)
    half = _Z_95 / (1 + z2 / runs) * math.sqrt(share * (1 - share) / runs + z2 / (4 * runs * runs))
    return max(middle - half, 0.0), min(middle + half, 1.0)
