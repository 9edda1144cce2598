"""The EAV's plant in moving air, and with a receiver whose height is wrong."""

import pytest

pytest.importorskip("jsbsim")

from heronry_tools.fly.atmosphere import Wind
from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.dynamics.moving_air import MovingAir
from heronry_tools.fly.mission import Mission

S = 1_000_000_000


def test_a_headwind_is_felt_by_the_airspeed_and_carries_the_aircraft_back() -> None:
    flown = []
    for wind in (Wind(), Wind(5.0, 0.0)):
        plant = EavPlant(1, air=MovingAir(1, wind))
        plant.advance(1 * S)
        flown.append(plant.truth())
    calm, headwind = flown
    assert headwind.airspeed_m_per_s > calm.airspeed_m_per_s + 2.0
    assert headwind.x_m < calm.x_m


def test_equal_seeds_fly_in_equal_gusts() -> None:
    def flown(seed: int):
        plant = EavPlant(1, air=MovingAir(seed, Wind(7.0, 30.0)))
        plant.advance(2 * S)
        return plant.truth()

    assert flown(4) == flown(4)
    assert flown(4) != flown(5)


def test_the_drawn_bias_of_height_is_that_of_the_receiver_alone() -> None:
    true, wrong = EavPlant(1), EavPlant(1, height_bias_m=2.5)
    readings = [plant.read("differential_receiver", 0) for plant in (true, wrong)]
    assert readings[1][2] - readings[0][2] == pytest.approx(2500, abs=1)
    assert readings[1][:2] == readings[0][:2]
    assert wrong.read("gps", 0) == true.read("gps", 0)


def test_a_bias_is_drawn_by_the_seed_within_its_limit() -> None:
    drawn = [Mission(seed, most_height_bias_m=4.0).height_bias_m() for seed in range(200)]
    assert -4.0 < min(drawn) < -3.5
    assert 3.5 < max(drawn) < 4.0
    assert Mission(3, most_height_bias_m=4.0).height_bias_m() == drawn[3]
    assert Mission(3).height_bias_m() == 0.0
