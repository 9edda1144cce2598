"""Estimates the position of the aircraft from its velocity and a camera beside the runway: an extended Kalman filter.

The filter has eight states: the position x, y, h in the runway's frame (m), the bias of the receiver's position in x,
y, h (m), and the bias of the camera's azimuth and elevation (rad). The measured velocity carries the position forward;
the error of the velocity is the process noise of the position. The biases of the receiver may change slowly; those of
the camera are constant.

The filter copes with three problems of real images:

- *Images are late.* An image shows the position at its exposure. The filter remembers how far the aircraft has flown
  since the exposure. It compares the image with the present position less this distance.
- *Some images are wrong.* The filter refuses an angle that is further than `GATE_SIGMA` from the expected one.
- *The filter may be wrong itself.* When `REFUSALS` angles of one axis in a row have been refused, the filter makes its
  position uncertain again, and counts this in `resets`. Without this rule, one early outlier would lock out all later
  images.

Measurements are scalars and are used one after the other, so no matrix is inverted.

Source: delayed images are treated as in S. Joo et al., "Vision Aided Inertial Navigation with Measurement Delay ...",
IEEE Aerospace Conference 2008.
"""

import math
from collections import deque
from collections.abc import Sequence

NS_PER_S = 1_000_000_000
STATES = 8
X, Y, H, BIAS_X, BIAS_Y, BIAS_H, BIAS_AZIMUTH, BIAS_ELEVATION = range(STATES)
_TRIANGLE = tuple((i, j) for i in range(STATES) for j in range(i, STATES))
GATE_SIGMA = 4.0
REFUSALS = 5

_PROCESS_M2_PER_S = 0.25**2
_IMAGE_RAD2 = 0.003**2
_RECEIVER_M2 = 0.5**2
_RECEIVER_BIAS_M = (4.0, 4.0, 7.0)
_RECEIVER_WANDERS_M2_PER_S = 0.15**2
_CAMERA_BIAS_RAD = (0.003, 0.002)
_START_M2 = 10.0**2
_KEPT_NS = 1_500_000_000
_NEAREST_M = 5.0  # a shorter horizontal distance from the camera counts as this one
_SLOPE, _AIM_M, _LEVEL_M = math.tan(math.radians(5.0)), -40.0, 45.0  # the nominal approach
_LEVEL_FROM_RAD = 0.055  # from this elevation on, the aircraft may still be on the level part
_SLOPE_LEAST = 0.018  # least difference between the slope and the line of sight
# Standard deviations of an aircraft from the nominal approach: of the range (share and m), sideways, in height.
_RANGE_SHARE, _RANGE_M, _BESIDE_M, _HEIGHT_M = 0.2, 5.0, 3.0, 0.5

Camera = tuple[float, float, float]


class TrackingFilter:
    """An extended Kalman filter for the position; times are on the clock of the PE on which it runs."""

    def __init__(self, camera_m: Camera, start_m: Sequence[float], now_ns: int) -> None:
        """Begin at the position `start_m`; the biases of the receiver and of the camera are not known yet.

        camera_m: position of the camera.
        start_m: x, y, h of the aircraft in the runway's frame, in m.
        """
        self._camera_m = camera_m
        self.state = [*start_m, *([0.0] * 5)]
        self.covariance = [[0.0] * STATES for _ in range(STATES)]
        variances = [_START_M2] * 3 + [s * s for s in (*_RECEIVER_BIAS_M, *_CAMERA_BIAS_RAD)]
        for i, variance in enumerate(variances):
            self.covariance[i][i] = variance
        self._now_ns = now_ns
        self._way_m = (0.0, 0.0, 0.0)
        self._ways: deque[tuple[int, tuple[float, float, float]]] = deque([(now_ns, self._way_m)])
        self._refused = [0, 0]
        self.resets = 0

    @classmethod
    def by_sight(cls, camera_m: Camera, elevation_rad: float, now_ns: int, *, sinks: bool) -> "TrackingFilter":
        """Begin with the camera alone, at the point where the line of sight meets the nominal approach.

        Along the line of sight, the position is uncertain. The height is the range times the elevation, so near the
        ground the height is good even if the range is wrong.

        sinks: True: the aircraft sinks, so it is on the slope of the approach. False: it may also be on the level part
            before the slope, where the camera can see it at the same elevation.
        """
        rise = math.tan(elevation_rad)
        if sinks or elevation_rad < _LEVEL_FROM_RAD:
            ahead = (_SLOPE * (camera_m[0] - _AIM_M) + camera_m[2]) / max(_SLOPE - rise, _SLOPE_LEAST)
        else:
            ahead = (_LEVEL_M - camera_m[2]) / rise
        made = cls(camera_m, (camera_m[0] - ahead, 0.0, camera_m[2] + rise * ahead), now_ns)
        along, covariance = (_RANGE_M + _RANGE_SHARE * ahead) ** 2, made.covariance
        covariance[X][X] = along
        covariance[X][H] = covariance[H][X] = -rise * along
        covariance[H][H] = rise * rise * along + _HEIGHT_M**2 + ahead * ahead * _IMAGE_RAD2
        covariance[Y][Y] = _BESIDE_M**2
        return made

    @classmethod
    def of_numbers(cls, camera_m: Camera, numbers: Sequence[float], now_ns: int) -> "TrackingFilter":
        """Go on from what `numbers` returned at `now_ns`; images that were exposed before have no effect."""
        tracking = cls(camera_m, numbers[:3], now_ns)
        tracking.state = list(numbers[:STATES])
        for (i, j), covariance in zip(_TRIANGLE, numbers[STATES:-1], strict=True):
            tracking.covariance[i][j] = tracking.covariance[j][i] = covariance
        tracking.resets = int(numbers[-1])
        return tracking

    def numbers(self) -> tuple[float, ...]:
        """Return the state, its covariance (the upper triangle, row by row), and the number of resets: 45 numbers."""
        return (*self.state, *(self.covariance[i][j] for i, j in _TRIANGLE), self.resets)

    def sigma(self, index: int) -> float:
        """Return the standard deviation of a state, as the filter estimates it."""
        return math.sqrt(max(self.covariance[index][index], 0.0))

    def advance(self, velocity_m_per_s: Sequence[float], now_ns: int) -> None:
        """Carry the position forward to `now_ns`, with the velocity along x, along y and upwards."""
        dt_s = (now_ns - self._now_ns) / NS_PER_S
        if dt_s <= 0.0:
            return
        self._now_ns = now_ns
        x, y, h = (v * dt_s for v in velocity_m_per_s)
        for i, way in enumerate((x, y, h)):
            self.state[i] += way
            self.covariance[i][i] += _PROCESS_M2_PER_S * dt_s
            self.covariance[BIAS_X + i][BIAS_X + i] += _RECEIVER_WANDERS_M2_PER_S * dt_s
        self._way_m = self._way_m[0] + x, self._way_m[1] + y, self._way_m[2] + h
        self._ways.append((now_ns, self._way_m))
        while self._ways[0][0] < now_ns - _KEPT_NS:
            self._ways.popleft()

    def use_receiver(self, position_m: Sequence[float]) -> None:
        """Correct the state by a position x, y, h (m) that the receiver has measured.

        The filter expects this position to be the real one plus the receiver's bias, which is in the state, and noise.
        """
        for i, measured in enumerate(position_m):
            row = [0.0] * STATES
            row[i] = row[BIAS_X + i] = 1.0
            self._use(row, measured - self.state[i] - self.state[BIAS_X + i], _RECEIVER_M2)

    def use_image(self, azimuth_rad: float, elevation_rad: float, exposed_ns: int) -> None:
        """Correct the state by the angles of an image; an image older than the filter's memory has no effect.

        exposed_ns: when the image was taken.
        """
        if exposed_ns < self._ways[0][0]:
            return
        self._use_angle(0, azimuth_rad, exposed_ns)
        self._use_angle(1, elevation_rad, exposed_ns)

    def _use_angle(self, axis: int, measured_rad: float, exposed_ns: int) -> None:
        predicted, row = self._expected(axis, self._since(exposed_ns))
        error = math.remainder(measured_rad - predicted, math.tau)
        spread = self._spread(row, _IMAGE_RAD2)
        if error * error > GATE_SIGMA**2 * spread:
            self._refused[axis] += 1
            if self._refused[axis] >= REFUSALS:
                self._doubt()
            return
        self._refused[axis] = 0
        self._use(row, error, _IMAGE_RAD2)

    def _doubt(self) -> None:
        """Make the position uncertain again, and uncorrelated with the biases."""
        self._refused = [0, 0]
        self.resets += 1
        for i in (X, Y, H):
            for j in range(STATES):
                self.covariance[i][j] = self.covariance[j][i] = 0.0
            self.covariance[i][i] = _START_M2

    def _since(self, exposed_ns: int) -> tuple[float, float, float]:
        """Return the distances (m) along x, y and h that were flown since `exposed_ns`.

        They are interpolated between the times that the filter remembers.
        """
        later_ns, later = self._now_ns, self._way_m
        for time_ns, way in reversed(self._ways):
            if time_ns <= exposed_ns:
                share = (exposed_ns - time_ns) / (later_ns - time_ns) if later_ns > time_ns else 0.0
                then = [a + share * (b - a) for a, b in zip(way, later, strict=True)]
                return self._way_m[0] - then[0], self._way_m[1] - then[1], self._way_m[2] - then[2]
            later_ns, later = time_ns, way
        return self._way_m[0] - later[0], self._way_m[1] - later[1], self._way_m[2] - later[2]

    def _expected(self, axis: int, since_m: tuple[float, float, float]) -> tuple[float, list[float]]:
        """Return the angle (rad) that an image should show, and its derivative with respect to each state.

        axis: 0 for azimuth, 1 for elevation. since_m: distances (m) along x, y, h flown since the image was taken.
        """
        ahead = self._camera_m[0] - (self.state[X] - since_m[0])
        right = self.state[Y] - since_m[1] - self._camera_m[1]
        up = self.state[H] - since_m[2] - self._camera_m[2]
        flat2 = max(ahead * ahead + right * right, _NEAREST_M**2)
        row = [0.0] * STATES
        if axis == 0:
            row[X], row[Y], row[BIAS_AZIMUTH] = right / flat2, ahead / flat2, 1.0
            return math.atan2(right, ahead) + self.state[BIAS_AZIMUTH], row
        flat = math.sqrt(flat2)
        far2 = flat2 + up * up
        row[X], row[Y] = up * ahead / (flat * far2), -up * right / (flat * far2)
        row[H], row[BIAS_ELEVATION] = flat / far2, 1.0
        return math.atan2(up, flat) + self.state[BIAS_ELEVATION], row

    def _spread(self, row: list[float], noise: float) -> float:
        return (
            sum(
                a * sum(p * b for p, b in zip(line, row, strict=True))
                for a, line in zip(row, self.covariance, strict=True)
                if a
            )
            + noise
        )

    def _use(self, row: list[float], error: float, noise: float) -> None:
        """Update state and covariance by one scalar measurement.

        row: derivative of the measurement with respect to each state.
        error: measured minus expected value.
        noise: variance of the measurement.
        """
        covariance = self.covariance
        gain = [sum(p * a for p, a in zip(line, row, strict=True)) for line in covariance]
        spread = sum(a * g for a, g in zip(row, gain, strict=True)) + noise
        for i, g in enumerate(gain):
            self.state[i] += g / spread * error
        for i in range(STATES):
            scale = gain[i] / spread
            for j in range(i + 1):
                covariance[i][j] = covariance[j][i] = covariance[i][j] - scale * gain[j]
