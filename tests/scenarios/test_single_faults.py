"""Start-up, and one fault after the other: each time all functions that can be served are heard again."""

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from scenarios.flights import MS, big_blue, elevator_and_chute, flying, placed_on, times_are_told, two_tails
from thoroughness import mostly_soak

BIG_BLUE_PES = ("flight", "nav", "air", "tail_a", "tail_b", "wing", "payload", "comms", "ground")


@pytest.mark.parametrize("spec", [big_blue(), elevator_and_chute(), two_tails()], ids=lambda spec: str(spec.name))
def test_everything_starts_at_its_own_moment_and_comes_to_one_epoch(spec: Spec) -> None:
    simulation = flying(spec)
    assert simulation.settle() == []
    assert len(simulation.events_of(events.PeJoined)) == len(spec.pes)
    assert simulation.events_of(events.PeLost) == []
    assert len(simulation.events_of(events.Reconfigured)) == 1
    times_are_told(simulation)


@pytest.mark.parametrize("pe", mostly_soak(BIG_BLUE_PES, ["flight", "comms"]))
def test_any_pe_is_killed_and_comes_back(pe: str) -> None:
    simulation = flying(big_blue())
    simulation.fleet.kill(pe)
    assert simulation.settle() == []
    assert len(simulation.events_of(events.Reconfigured)) == 2
    assert placed_on(simulation, pe) == set()
    simulation.fleet.restore(pe)
    assert simulation.settle() == []
    assert placed_on(simulation, pe)
    times_are_told(simulation)


@pytest.mark.parametrize("pe", ["sensor_pe", "control_pe", "tail_pe"])
def test_a_demux_whose_driver_dies_is_driven_from_the_other_side(pe: str) -> None:
    simulation = flying(two_tails())
    simulation.fleet.kill(pe)
    assert simulation.settle() == []
    simulation.fleet.restore(pe)
    assert simulation.settle() == []


def test_a_pe_that_starts_late_is_waited_for_and_one_that_starts_very_late_joins() -> None:
    simulation = Simulation(elevator_and_chute(), 1)
    simulation.at(210 * MS, lambda: simulation.fleet.kill("tail_pe"))
    simulation.at(7_000 * MS, lambda: simulation.fleet.restore("tail_pe"))
    simulation.run_until(6_900 * MS)
    assert simulation.unsettled() == []
    assert not simulation.witness.served("elevator", simulation.now_ns)
    assert simulation.settle() == []
    assert simulation.witness.served("elevator", simulation.now_ns)


def test_a_reboot_faster_than_a_heartbeat_is_seen() -> None:
    simulation = flying(two_tails())
    simulation.fleet.kill("tail_pe")
    simulation.run_for(3 * MS)
    simulation.fleet.restore("tail_pe")
    assert simulation.settle() == []
    assert "rebooted" in simulation.events_of(events.PeLost)[-1].cause


def test_a_pe_that_keeps_failing_is_held_down_for_longer_each_time() -> None:
    simulation = flying(two_tails())
    downs = []
    for _ in range(4):
        simulation.fleet.kill("sensor_pe")
        simulation.run_for(300 * MS)
        simulation.fleet.restore("sensor_pe")
        assert simulation.settle() == []
        downs.append(
            simulation.events_of(events.PeJoined)[-1].t_ns - simulation.events_of(events.PeHeardAgain)[-1].t_ns
        )
    assert downs == sorted(downs)
    assert downs[-1] > 6 * downs[0]


@pytest.mark.parametrize("spec", [elevator_and_chute(), two_tails()], ids=["on one PE", "on two PEs"])
def test_a_servo_that_sticks_is_reported_by_its_monitor_and_the_other_one_drives(spec: Spec) -> None:
    simulation = flying(spec)
    simulation.run_for(5_000 * MS)
    assert simulation.events_of(events.FaultReported) == []
    simulation.fail_device("elevator_servo_1", "stuck")
    simulation.run_for(15_000 * MS)
    assert [told.element for told in simulation.events_of(events.FaultReported)] == ["device:elevator_servo_1"]
    assert simulation.settle() == []
    last = simulation.witness.last_output("elevator")
    assert last is not None
    assert last.module == "servo_driver_2"


def with_a_twin_of_what_raises() -> Spec:
    text = shipped_spec_path("elevator_and_chute").read_text()
    raises = '  state_estimator: {image: "scenarios.raising:RaisesAfterHalfASecond", '
    text = text.replace("  state_estimator: {", raises)
    twin = "  twin: {image: state_estimator, gives: {state_info: 1}, cpu: 0.2, ram: 4KiB, flash: 8KiB, rate_hz: 40}"
    return loads(text.replace("functions:\n", f"{twin}\nfunctions:\n"), "raising.dg.yaml")


def test_a_module_that_raises_is_stopped_and_reported_and_the_plan_does_without_it() -> None:
    simulation = Simulation(with_a_twin_of_what_raises())
    simulation.truth.broke("state_estimator", "tail_pe")  # half a second after it was started it raises
    simulation.run_for(1_500 * MS)
    assert simulation.settle() == []
    assert [told.element for told in simulation.events_of(events.FaultReported)] == ["module:state_estimator@tail_pe"]
    assert simulation.witness.served("elevator", simulation.now_ns)
