"""The EAV held at its start, as real time needs it, and on the ground in an attitude in which no wheel carries."""

import math

import pytest

pytest.importorskip("jsbsim")

from heronry_tools.console.errors import UserError
from heronry_tools.fly.dynamics import model
from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.live.plant_process import HELD
from lab.flights.loop import Loop

S = 1_000_000_000


class HeldPlant(EavPlant):
    """The plant as the plant process serves it before the release."""

    def __init__(self) -> None:
        super().__init__(1, held=True)

    def read(self, device, now_ns):
        reading = super().read(device, now_ns)
        return HELD.get(device, reading)


def test_the_flight_of_a_held_aircraft_begins_with_its_release() -> None:
    plant = EavPlant(1, held=True, corrections_lost_s=1.0)
    start = plant.truth()
    plant.write("elevator_1", 5.0, 0)
    plant.advance(4 * S)
    assert plant.truth() == start, "the aircraft stays where it is"
    assert plant.read("elevator_sensor", 4 * S) == 5.0, "its surfaces move"
    *_, age_ms = plant.read("camera", 4 * S)
    assert age_ms < 1000, "the camera sees it"
    plant.write("elevator_1", 1.3, 4 * S)
    plant.release(4 * S)
    plant.advance(round(4.5 * S))
    flying = plant.truth()
    assert flying.time_s == 0.5
    assert flying.x_m == pytest.approx(start.x_m + 9.0, abs=0.2)
    assert abs(plant.read("differential_receiver", round(4.9 * S))[2] - 45_000) < 1_000
    assert abs(plant.read("differential_receiver", 6 * S)[2] - 1000 * plant.truth().height_m) > 2_000


def test_a_long_hold_winds_no_control_loop_up_and_no_monitor_finds_a_fault() -> None:
    loop = Loop(HeldPlant(), "precise", also=("eav_elevator_monitor", "eav_accuracy_monitor"))
    for _ in range(240):
        loop.step()
    assert abs(loop.data["elevator_demand"]) < 0.1
    assert loop.data["throttle_demand"] == pytest.approx(0.2, abs=0.01)
    assert {image: context.reported for image, context in loop.contexts.items() if context.reported} == {}


def rolled_into_the_ground() -> EavPlant:
    """Return an aircraft that flies 6 m above the ground with full aileron."""
    plant = EavPlant(1, start_m=(-620.0, 0.0, 6.0))
    plant.write("elevator_1", 0.0, 0)
    plant.write("aileron_1", 20.0, 0)
    return plant


def test_an_aircraft_that_hits_the_ground_on_its_side_stays_there() -> None:
    plant, fastest, touching = rolled_into_the_ground(), 0.0, set()
    for tick in range(60):
        plant.advance(tick * S // 20)
        truth = plant.truth()
        touching.update(truth.touching)
        fastest = max(fastest, math.hypot(truth.north_m_per_s, truth.east_m_per_s, truth.up_m_per_s))
    assert "right_tip" in touching
    assert fastest < 25.0
    assert truth.height_m < 3.0


def test_a_model_that_diverges_says_so_again_and_again(monkeypatch) -> None:
    monkeypatch.setattr(model, "_LEAST_COSINE", -2.0)  # the wheels carry in every attitude
    plant = rolled_into_the_ground()
    for _ in range(2):
        with pytest.raises(UserError, match=r"the flight model of 'eav' has diverged \(seed 1, after 1\.\d\d s\)"):
            plant.advance(3 * S)
