"""The standard atmosphere: conversions between pressure and altitude, and between dynamic pressure and airspeed.

The plant computes pressures from altitudes by these formulas. The barometric images compute altitudes from pressures by
the same formulas, so that their altitude is that of the plant.

Source: ICAO Standard Atmosphere (ICAO Doc 7488, ISO 2533), geopotential altitude, layers from -2 to 47 km. A layer has
a constant lapse rate L. If L is 0, the pressure falls exponentially with altitude; if not, the pressure is a power of
the temperature, with the exponent -g0 / (R L). The pressure at the base of a layer is computed from the layer below,
and not copied from the standard's table, so that the pressure does not jump between two layers.
"""

import math
from dataclasses import dataclass

SEA_LEVEL_PRESSURE_HPA = 1013.25
SEA_LEVEL_DENSITY_KG_PER_M3 = 1.225

_GRAVITY_M_PER_S2 = 9.80665
_GAS_CONSTANT_J_PER_KG_K = 287.05287
_LOWEST_M, _HIGHEST_M = -2_000.0, 47_000.0
_PA_PER_HPA = 100.0


@dataclass(frozen=True, slots=True)
class _Layer:
    base_m: float
    base_k: float
    lapse_k_per_m: float
    base_hpa: float

    def pressure_hpa(self, altitude_m: float) -> float:
        height_m = altitude_m - self.base_m
        if self.lapse_k_per_m == 0.0:
            return self.base_hpa * math.exp(-_GRAVITY_M_PER_S2 * height_m / (_GAS_CONSTANT_J_PER_KG_K * self.base_k))
        ratio = 1.0 + self.lapse_k_per_m * height_m / self.base_k
        return self.base_hpa * math.pow(ratio, -_GRAVITY_M_PER_S2 / (_GAS_CONSTANT_J_PER_KG_K * self.lapse_k_per_m))

    def altitude_m(self, pressure_hpa: float) -> float:
        ratio = pressure_hpa / self.base_hpa
        if self.lapse_k_per_m == 0.0:
            return self.base_m - math.log(ratio) * _GAS_CONSTANT_J_PER_KG_K * self.base_k / _GRAVITY_M_PER_S2
        power = math.pow(ratio, -_GAS_CONSTANT_J_PER_KG_K * self.lapse_k_per_m / _GRAVITY_M_PER_S2)
        return self.base_m + self.base_k / self.lapse_k_per_m * (power - 1.0)


def _layers() -> tuple[_Layer, ...]:
    lapses = ((0.0, -0.0065), (11_000.0, 0.0), (20_000.0, 0.001), (32_000.0, 0.0028))
    layers = [_Layer(0.0, 288.15, lapses[0][1], SEA_LEVEL_PRESSURE_HPA)]
    for base_m, lapse in lapses[1:]:
        below = layers[-1]
        base_k = below.base_k + below.lapse_k_per_m * (base_m - below.base_m)
        layers.append(_Layer(base_m, base_k, lapse, below.pressure_hpa(base_m)))
    return tuple(layers)


_LAYERS = _layers()
_HIGHEST_PRESSURE_HPA = _LAYERS[0].pressure_hpa(_LOWEST_M)
_LOWEST_PRESSURE_HPA = _LAYERS[-1].pressure_hpa(_HIGHEST_M)


def pressure_hpa(altitude_m: float) -> float:
    """Static pressure at an altitude; the altitude is limited to -2 000..47 000 m."""
    held = min(max(altitude_m, _LOWEST_M), _HIGHEST_M)
    layer = next((layer for layer in reversed(_LAYERS) if held >= layer.base_m), _LAYERS[0])
    return layer.pressure_hpa(held)


def altitude_m(static_hpa: float) -> float:
    """Altitude of a static pressure in the standard atmosphere, limited to -2 000..47 000 m."""
    held = min(max(static_hpa, _LOWEST_PRESSURE_HPA), _HIGHEST_PRESSURE_HPA)
    layer = next((layer for layer in reversed(_LAYERS) if held <= layer.base_hpa), _LAYERS[0])
    return layer.altitude_m(held)


def density_kg_per_m3(static_hpa: float) -> float:
    """Air density of the standard atmosphere at this static pressure."""
    altitude = altitude_m(static_hpa)
    layer = next((layer for layer in reversed(_LAYERS) if altitude >= layer.base_m), _LAYERS[0])
    temperature_k = layer.base_k + layer.lapse_k_per_m * (altitude - layer.base_m)
    return static_hpa * _PA_PER_HPA / (_GAS_CONSTANT_J_PER_KG_K * temperature_k)


def indicated_airspeed_m_per_s(differential_hpa: float) -> float:
    """Indicated airspeed for a differential pressure of the pitot, by the incompressible formula; 0 for suction."""
    return math.sqrt(2.0 * max(differential_hpa, 0.0) * _PA_PER_HPA / SEA_LEVEL_DENSITY_KG_PER_M3)


def differential_hpa(indicated_m_per_s: float) -> float:
    """Differential pressure of the pitot at an indicated airspeed; the inverse of `indicated_airspeed_m_per_s`."""
    return 0.5 * SEA_LEVEL_DENSITY_KG_PER_M3 * indicated_m_per_s**2 / _PA_PER_HPA
