"""The display for the pilot on the ground during a landing: the glide path, and the aircraft's position relative to it.

From telemetry it computes the height above the path that ends at the field, and the turn towards the field. A value
that is missing is not shown. A restart loses nothing.
"""

import math
from typing import ClassVar

from heronry_agent.module import Inputs
from heronry_agent.parts.reading import number
from heronry_tools.aircraft.images.guidance import HOME_ALTITUDE_M, home_bearing_and_distance, turn_deg
from heronry_tools.aircraft.images.telemetry import GroundDisplay

_PATH_DEG = 4.0


class PilotView(GroundDisplay):
    """A `GroundDisplay` that also shows the way to the field.

    `distance` is in m, `above` is the height above the glide path in m, `turn` is in degrees, to the right positive.
    """

    columns: ClassVar[tuple[str, ...]] = ("telemetry_altitude",)

    def more_words(self, inputs: Inputs) -> list[str]:
        """Return the additional words of the display's line: those of the base class, then the way to the field."""
        return super().more_words(inputs) + _path_words(inputs)


def _path_words(inputs: Inputs) -> list[str]:
    place = (number(inputs, "telemetry_latitude"), number(inputs, "telemetry_longitude"))
    if place[0] is None or place[1] is None:
        return []
    bearing_deg, distance_m = home_bearing_and_distance(place[0], place[1])
    words = [f"distance={distance_m:.0f}"]
    altitude_m, course_deg = number(inputs, "telemetry_altitude"), number(inputs, "telemetry_course")
    if altitude_m is not None:
        path_m = HOME_ALTITUDE_M + distance_m * math.tan(math.radians(_PATH_DEG))
        words.append(f"above={altitude_m - path_m:.0f}")
    if course_deg is not None:
        words.append(f"turn={turn_deg(bearing_deg, course_deg):.0f}")
    return words
