"""The aircraft that `heronry fly` knows, each with the code that runs and reports its flights.

The aircraft of a spec is recognized by a device that no other aircraft has. To add another aircraft, add a `Kind` to
this file (docs/flights.md says how).
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
# By aircraft: a device that no other aircraft has. A spec with this device is a spec of this aircraft.
_KNOWN_BY: dict[Name, str] = {"eav": "pan_tilt", "big_blue": "inflation_valve"}


@dataclass(frozen=True, slots=True)
class Kind:
    """The code that runs and reports the flights of one aircraft.

    Each aircraft has its own types of missions and results.
    A result must have a method `document()`, which gives JSON data, and an attribute `violations`.

    site: where the aircraft lands
    fly: runs a mission and returns its result
    fly_recorded: as `fly`, but returns the record too
    line: says in one line how a flight ended
    summary: makes statistics of many results, as JSON data
    figures: returns the statistics that `summary` has made, as text
    """

    site: Site
    fly: Callable[[Spec, Any], Any]
    fly_recorded: Callable[[Spec, Any], tuple[Any, FlightRecord]]
    line: Callable[[Any], str]
    summary: Callable[[Sequence[Any]], dict[str, Any]]
    figures: Callable[[dict[str, Any]], str]

    def dispersed(self, landing: Any) -> Landing:
        """Return from the result of one flight what the report of many flights shows."""
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
    """Return the name of the aircraft that `spec` describes; raises UserError if it describes none of `KINDS`."""
    for name, device in _KNOWN_BY.items():
        if device in spec.devices:
            return name
    raise UserError(
        f"spec '{spec.name}' cannot be flown with this command: it does not have the devices of an aircraft with a "
        f"flight dynamics model; name a spec of {' or '.join(_KNOWN_BY)}"
    )
