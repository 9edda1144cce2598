"""The rover beside the runway: a camera on a pan and tilt head, and the image processing behind it.

The camera takes an image every 100 to 200 ms. The result of an image is known 100 to 250 ms after the image was taken.
The result is the direction of the aircraft from the camera, in the runway's frame:

    azimuth      0 towards the approach (negative x), positive to the right as seen by the landing aircraft (positive y)
    elevation    0 at the horizon, positive upwards

The camera has these errors: white noise, a constant bias of its alignment, outliers, and lost images, single ones and
bursts. The camera sees the aircraft only within its field of view.
"""

import math
from collections import deque
from random import Random

NS_PER_S = 1_000_000_000
POSITION_M = (100.0, 12.0, 0.6)  # x, y, height of the camera
LONGEST_DELAY_NS = 250_000_000
_FIELD_RAD = math.radians(20.0)  # half the field of view
_WHITE_RAD = 0.0015
_BIAS_RAD = (0.003, 0.002)
_PERIOD_NS = (100_000_000, 200_000_000)
_DELAY_NS = (100_000_000, LONGEST_DELAY_NS)
_LOST = 0.05
_BURST_BEGINS = 0.01
_BURST_IMAGES = (3, 8)
_OUTLIER = 0.01
_OUTLIER_RAD = 0.15


def angles_rad(x_m: float, y_m: float, height_m: float) -> tuple[float, float]:
    """Return the azimuth and elevation (rad) at which the camera sees a point of the runway's frame."""
    ahead, right, up = POSITION_M[0] - x_m, y_m - POSITION_M[1], height_m - POSITION_M[2]
    return math.atan2(right, ahead), math.atan2(up, math.hypot(ahead, right))


class Camera:
    """Takes images of the aircraft, and keeps the result of the newest processed image."""

    def __init__(self, seed: int) -> None:
        self._chance = Random(f"{seed} camera")
        self.bias_rad = tuple(self._chance.gauss(0.0, sigma) for sigma in _BIAS_RAD)
        self._next_ns = self._chance.randrange(_PERIOD_NS[1])
        self._in_work: deque[tuple[int, int, tuple[float, float]]] = deque()  # known at, exposed at, angles
        self._result: tuple[int, tuple[float, float]] | None = None
        self._burst = 0
        self.blind = False

    def step(self, now_ns: int, seen_rad: tuple[float, float], head_rad: tuple[float, float]) -> None:
        """Take an image if one is due, and make each image available that has been processed by now.

        seen_rad: azimuth and elevation of the aircraft
        head_rad: azimuth and elevation in which the head points
        """
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + self._chance.randint(*_PERIOD_NS)
            self._expose(now_ns, seen_rad, head_rad)
        while self._in_work and self._in_work[0][0] <= now_ns:
            _, exposed_ns, angles = self._in_work.popleft()
            self._result = exposed_ns, angles

    def newest(self) -> tuple[int, tuple[float, float]] | None:
        """Return when the newest processed image was taken (ns), and the result: azimuth and elevation in rad.

        Return None while no image has been processed.
        """
        return self._result

    def _expose(self, now_ns: int, seen_rad: tuple[float, float], head_rad: tuple[float, float]) -> None:
        chance = self._chance
        delay_ns = chance.randint(*_DELAY_NS)
        noise = [chance.gauss(0.0, _WHITE_RAD) + bias for bias in self.bias_rad]
        lost, outlier, begins = (chance.random() for _ in range(3))
        if self._burst:
            self._burst -= 1
        elif begins < _BURST_BEGINS:
            self._burst = chance.randint(*_BURST_IMAGES)
        off = [chance.uniform(-_OUTLIER_RAD, _OUTLIER_RAD) for _ in range(2)]
        in_view = all(abs(seen - head) < _FIELD_RAD for seen, head in zip(seen_rad, head_rad, strict=True))
        if self.blind or lost < _LOST or self._burst or not in_view:
            return
        azimuth, elevation = (seen + error for seen, error in zip(seen_rad, noise, strict=True))
        if outlier < _OUTLIER:
            azimuth, elevation = azimuth + off[0], elevation + off[1]
        known_ns = max(now_ns + delay_ns, self._in_work[-1][0] if self._in_work else 0)
        self._in_work.append((known_ns, now_ns, (azimuth, elevation)))
