"""Errors of sensors: a constant bias, a drift that wanders around zero, and white noise.

Each error has its own random generator, with a seed made of the flight's seed and the error's name. So the noise of one
sensor does not depend on how often another one is read.
"""

import math
from random import Random


class SensorError:
    """The error of one measured quantity, in its unit; `sample` must be called once per sample of the sensor."""

    def __init__(
        self,
        seed: int,
        name: str,
        *,
        period_s: float,
        white: float = 0.0,
        bias: float = 0.0,
        drift: float = 0.0,
        drift_s: float = 60.0,
    ) -> None:
        """Set the size of the error, in the unit of the quantity.

        period_s: time between two samples
        white: standard deviation of the noise
        bias: the constant part of the error
        drift: standard deviation of the drift
        drift_s: correlation time of the drift
        """
        self._chance = Random(f"{seed} {name}")
        self._white, self.bias = white, bias
        self._keep = math.exp(-period_s / drift_s)
        self._stir = drift * math.sqrt(1.0 - self._keep**2)
        self._drift = self._chance.gauss(0.0, drift) if drift else 0.0

    @property
    def slow(self) -> float:
        """Return the bias plus the drift at the last sample, without the noise."""
        return self.bias + self._drift

    def sample(self) -> float:
        """Return the error of the next sample."""
        if self._stir:
            self._drift = self._keep * self._drift + self._chance.gauss(0.0, self._stir)
        noise = self._chance.gauss(0.0, self._white) if self._white else 0.0
        return self.bias + self._drift + noise
