"""The aircraft that `heronry fly` knows: what flies a mission of each, and what says how the flights went.

A spec flies the aircraft whose devices it has. An aircraft of one's own is another `Kind` here (docs/flights.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.fly import campaign, glider_campaign
from heronry_tools.fly.acceptance import Site
from heronry_tools.fly.flight import EavFlight, fly_landing
from heronry_tools.fly.glider_flight import GliderFlight, fly_glider
from heronry_tools.fly.record import FlightRecord
from heronry_tools.fly.report.dispersion_page import Landing

Name = Literal["eav", "big_blue"]
# One device that no other aircraft has, by which a spec is known.
_KNOWN_BY: dict[Name, str] = {"eav": "pan_tilt", "big_blue": "inflation_valve"}


@dataclass(frozen=True, slots=True)
class Kind:
    """One aircraft. Missions and landings are its own types; each landing has `document()` and `violations`."""

    site: Site
    fly: Callable[[Spec, Any], Any]
    fly_recorded: Callable[[Spec, Any], tuple[Any, FlightRecord]]
    line: Callable[[Any], str]
    summary: Callable[[Sequence[Any]], dict[str, Any]]
    figures: Callable[[dict[str, Any]], str]

    def dispersed(self, landing: Any) -> Landing:
        """Give what the report of many flights draws of one."""
        wind = landing.mission.wind().speed_m_per_s
        return Landing(
            landing.mission.seed, landing.touchdown, wind, getattr(landing, "height_bias_m", None), self.site
        )


KINDS: dict[Name, Kind] = {
    "eav": Kind(
        "runway",
        fly_landing,
        lambda spec, mission: EavFlight(spec, mission).fly(),
        campaign.line,
        campaign.summary,
        campaign.figures,
    ),
    "big_blue": Kind(
        "field",
        fly_glider,
        lambda spec, mission: GliderFlight(spec, mission).fly(),
        glider_campaign.line,
        glider_campaign.summary,
        glider_campaign.figures,
    ),
}


def aircraft_of(spec: Spec) -> Name:
    """Give the aircraft whose devices a spec has; raises UserError where it is none of them."""
    for name, device in _KNOWN_BY.items():
        if device in spec.devices:
            return name
    raise UserError(
        f"the spec '{spec.name}' has the devices of no aircraft in a flight dynamics model; "
        f"those are {' and '.join(_KNOWN_BY)}"
    )
