"""The EAV's modes against Table 2 of the paper, by JSBSim's linearisation and by a fit to flights in the time domain.

Table 2 is the paper's identification in flight at its cruise speed, 45 kt. Misprints of the tables, and what we take:

- Dutch roll: the pole is printed as -0.0692, which is the spiral's. Its frequency 5.0001 rad/s and damping 0.4042 mean
  -2.0210 +- 4.5735i.
- 18.5 lb is 8.39 kg, not 8.22; 32.7 oz/sq ft is the loading of neither weight (34.2 empty, 42.9 full).

The phugoid is not met, and must not be: see `test_the_phugoid_of_table_2_is_not_that_of_an_open_loop`.
"""

import math
from functools import cache

import pytest

from heronry_tools.fly.dynamics.model import Model

np = pytest.importorskip("numpy")
jsbsim = pytest.importorskip("jsbsim")

LONGITUDINAL, LATERAL = ("Vt", "Alpha", "Theta", "Q"), ("Beta", "Phi", "P", "R")
DUTCH_ROLL = complex(-5.0001 * 0.4042, 5.0001 * math.sqrt(1.0 - 0.4042**2))
TABLE_2 = {"roll": -7.9305, "Dutch roll": DUTCH_ROLL, "spiral": -0.0692, "short period": complex(-6.7387, 4.6572)}
PHUGOID = complex(-0.9535, 0.3622)


def _trimmed():
    """The EAV in level flight at 45 kt, 300 ft, with a speed-dependent thrust that is held."""
    model = Model("eav", seed=0)
    fdm = model.fdm
    fdm["ic/vc-kts"], fdm["ic/h-sl-ft"], fdm["ic/gamma-deg"] = 45.0, 300.0, 0.0
    fdm.run_ic()
    fdm["propulsion/engine[0]/set-running"] = 1
    fdm.do_trim(1)
    return fdm


def _modes(longitudinal, lateral) -> dict[str, complex]:
    upper = sorted((pole for pole in longitudinal if pole.imag > 0), key=abs)
    real = sorted(pole.real for pole in lateral if abs(pole.imag) < 1e-6)
    dutch_roll = next(pole for pole in lateral if pole.imag > 1e-6)
    return {"roll": real[0], "spiral": real[1], "Dutch roll": dutch_roll, "short period": upper[1], "phugoid": upper[0]}


@cache
def _linearised():
    linear = jsbsim.FGLinearization(_trimmed())
    matrix, names = linear.system_matrix, linear.x_names

    def poles(states):
        rows = [names.index(state) for state in states]
        return np.linalg.eigvals(matrix[np.ix_(rows, rows)])

    return _modes(poles(LONGITUDINAL), poles(LATERAL))


def _flown(properties, moved, size: float):
    """Poles of the linear system that fits the free flight after a doublet of the surfaces `moved`, at 120 Hz."""
    fdm, rows = _trimmed(), []
    rest = {name: fdm[name] for name in moved}
    level = np.array([fdm[name] for name in properties])
    for step in range(36 + 480):
        for name in moved:
            fdm[name] = rest[name] + (size if step < 18 else -size if step < 36 else 0.0)
        fdm.run()
        if step >= 38:
            rows.append([fdm[name] for name in properties])
    states = np.array(rows) - level
    ahead, *_ = np.linalg.lstsq(states[:-1], states[1:], rcond=None)
    return np.log(np.linalg.eigvals(ahead.T).astype(complex)) * 120.0


@cache
def _identified():
    longitudinal = _flown(
        ("velocities/vt-fps", "aero/alpha-rad", "attitude/theta-rad", "velocities/q-rad_sec"),
        ("fcs/elevator-cmd-norm",),
        0.03,
    )
    lateral = _flown(
        ("aero/beta-rad", "attitude/phi-rad", "velocities/p-rad_sec", "velocities/r-rad_sec"),
        ("fcs/aileron-cmd-norm", "fcs/rudder-cmd-norm"),
        0.03,
    )
    return _modes(longitudinal, lateral)


@pytest.mark.parametrize("mode", TABLE_2)
def test_the_linearised_modes_are_those_of_table_2_within_1_percent(mode) -> None:
    assert abs(_linearised()[mode] - TABLE_2[mode]) <= 0.01 * abs(TABLE_2[mode])


@pytest.mark.parametrize("mode", [mode for mode in TABLE_2 if mode != "spiral"])
def test_the_modes_in_flight_are_those_of_table_2_within_5_percent(mode) -> None:
    """The spiral is too slow to be seen in four seconds; it is checked by linearisation alone."""
    assert abs(_identified()[mode] - TABLE_2[mode]) <= 0.05 * abs(TABLE_2[mode])


def test_the_phugoid_of_table_2_is_not_that_of_an_open_loop() -> None:
    """In the open loop the frequency is about sqrt(2) g / V (Lanchester), which no aerodynamic derivative changes much.

    Table 2 has 1.02 rad/s, damped with 0.93. At 45 kt Lanchester's is 0.60 rad/s at most, and the damping asked for
    would be 18 N per m/s of speed, ten times the aircraft's whole drag per m/s. A loop of pitch or height was probably
    closed when it was identified. So the model keeps the phugoid that its lift and drag give it.
    """
    ours, lanchester = _linearised()["phugoid"], math.sqrt(2.0) * 9.81 / (45.0 * 0.5144)
    assert 0.6 * lanchester < abs(ours) < lanchester < 0.6 * abs(PHUGOID)
    assert -ours.real / abs(ours) < 0.35 < -PHUGOID.real / abs(PHUGOID)
