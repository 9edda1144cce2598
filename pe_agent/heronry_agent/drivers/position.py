"""The value of a satellite receiver: a position as four whole numbers (head of this package)."""

from typing import Final

UNKNOWN_TRACK: Final = -1  # the receiver has told no track yet: it has not moved


def position(latitude_deg: float, longitude_deg: float, altitude_m: float, track_deg: float | None) -> tuple[int, ...]:
    """Return the value of a position; raises ValueError for what is no place on earth, or not finite."""
    if not (-90 <= latitude_deg <= 90 and -180 <= longitude_deg <= 180 and -1_000 <= altitude_m <= 1e6):
        raise ValueError(f"{latitude_deg}, {longitude_deg} at {altitude_m} m is no position")
    track = UNKNOWN_TRACK if track_deg is None or not 0 <= track_deg <= 360 else round(track_deg * 1e5)
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7), round(altitude_m * 1e3), track
