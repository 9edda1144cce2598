"""The manager dies, and another mastership begins: no function stops, and the new manager adopts what runs."""

import pytest

from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement
from heronry_tools.sim.flight.simulation import Simulation
from scenarios.flights import MS, at_end_of, big_blue, flying, management_frames, times_are_told, two_tails
from thoroughness import sample


def successor(simulation: Simulation, after_ns: int) -> None:
    """The manager dies now, and is started again later."""
    simulation.managers.kill()
    simulation.at(simulation.now_ns + after_ns, simulation.managers.start)


def test_without_a_manager_every_function_goes_on_and_the_next_manager_adopts_what_runs() -> None:
    simulation = flying(two_tails())
    successor(simulation, 2_000 * MS)
    simulation.run_for(1_990 * MS)
    assert simulation.unsettled() == []
    assert simulation.settle() == []
    assert simulation.witness.outages(simulation.now_ns) == []
    (epoch,) = simulation.events_of(events.Reconfigured)
    (adopted,) = simulation.events_of(events.Adopted)
    assert adopted.epoch == epoch.epoch
    assert simulation.events_of(events.PeLost) == []


def test_a_second_manager_hears_the_first_and_does_not_start() -> None:
    simulation = flying(two_tails())
    active_manager = simulation.managers.foremost
    simulation.managers.start(127)
    assert simulation.settle() == []
    second = simulation.managers.running[127]
    assert second.stopped is not None
    assert "manager 126 is already active" in second.stopped
    assert active_manager is not None
    assert active_manager.stopped is None


@pytest.mark.parametrize("pe", ["sensor_pe", "control_pe", "tail_pe"])
def test_a_pe_that_was_cut_off_over_a_change_of_mastership_joins(pe: str) -> None:
    simulation = flying(two_tails())
    simulation.fleet.cut(pe)
    simulation.run_for(200 * MS)
    successor(simulation, 100 * MS)
    simulation.run_for(600 * MS)
    simulation.fleet.mend(pe)
    assert simulation.settle() == []
    assert "which no manager commanded" not in str(simulation.events_of(events.PeLost))


def test_a_fleet_that_restarts_around_one_that_does_not_gets_new_epochs() -> None:
    simulation = flying(two_tails())
    simulation.fleet.cut("sensor_pe")
    successor(simulation, 50 * MS)
    for pe in ("control_pe", "tail_pe"):
        simulation.fleet.kill(pe)
        simulation.fleet.restore(pe)
    simulation.run_for(300 * MS)
    simulation.fleet.mend("sensor_pe")
    assert simulation.settle() == []


def test_the_manager_dies_at_the_end_of_every_message() -> None:
    recorded = flying(two_tails(), keep_trace=True)
    recorded.fleet.kill("tail_pe")
    recorded.run_for(500 * MS)
    known_ns = recorded.events_of(events.PeLost)[-1].t_ns
    wrong = {}
    for frame in sample(management_frames(recorded.trace, known_ns, recorded.events_of(events.Reconfigured)[-1].t_ns)):
        simulation = flying(two_tails())
        at_end_of(simulation, frame, lambda flight=simulation: successor(flight, 150 * MS))
        simulation.fleet.kill("tail_pe")
        violations = simulation.settle()
        times_are_told(simulation)
        if violations:
            wrong[frame] = violations
    assert wrong == {}


def test_big_blue_under_a_new_mastership_while_a_processor_comes_back() -> None:
    simulation = flying(big_blue())
    simulation.fleet.kill("nav")
    simulation.run_for(90 * MS)
    successor(simulation, 200 * MS)
    simulation.fleet.restore("nav")
    assert simulation.settle() == []


def reported(simulation: Simulation, module: str) -> None:
    """Let a module raise until its PE stops it for good, fly until the manager has heard that, and mend the module."""
    simulation.fleet.broken_modules[module] = "raise"
    while not simulation.events_of(events.FaultReported):
        simulation.run_for(MS // 10)
    simulation.fleet.broken_modules.clear()


def test_a_module_that_is_cleared_before_there_is_a_plan_without_it_runs_again() -> None:
    simulation = flying(two_tails())
    reported(simulation, "chute_logic")
    reply = simulation.operator.say(ClearElement("module:chute_logic"))
    assert reply is not None
    assert reply.done
    assert simulation.settle() == []
    assert simulation.managers.foremost is not None
    assert simulation.managers.foremost.core.status()["latched"] == []


def test_a_fault_whose_manager_died_when_it_had_acknowledged_it_is_reported_again_to_the_next_one() -> None:
    simulation = Simulation(two_tails(), 3, standby=True)
    simulation.run_for(1_000 * MS)
    reported(simulation, "chute_logic")
    simulation.run_for(MS)  # the acknowledgement is sent, and the next heartbeat is not
    simulation.managers.kill()
    assert simulation.settle() == []
    told = [event.element for event in simulation.events_of(events.FaultReported)]
    assert told == ["module:chute_logic@control_pe"] * 2
