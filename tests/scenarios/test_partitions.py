"""A PE that lives and is not heard, or does not hear: it drives on for a while, and no PE may take its place too soon.

Here planning is quick (2 ms), so that nothing but the protocol keeps the new driver waiting.
"""

from random import Random

import pytest

from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from scenarios.flights import (
    MS,
    at_end_of,
    big_blue,
    fail_receiver,
    flying,
    management_frames,
    times_are_told,
    two_tails,
)
from thoroughness import mostly_soak, part_of, sample


@pytest.mark.parametrize("pe", ["sensor_pe", "control_pe", "tail_pe"])
def test_a_pe_is_cut_off_and_mended_after_any_time(pe: str) -> None:
    for seed in range(part_of(12, 3)):
        simulation = flying(two_tails(), seed, decide_ns=2 * MS)
        simulation.fleet.cut(pe)
        simulation.run_for(Random(seed).choice((30, 66, 70, 80, 95, 110, 150, 400)) * MS)
        simulation.fleet.mend(pe)
        assert simulation.settle() == [], seed
        times_are_told(simulation)


CUTS = [("flight", 68), ("flight", 90), ("nav", 105), ("tail_a", 90), ("comms", 300)]


@pytest.mark.parametrize(
    "cut", mostly_soak(CUTS, [("flight", 90), ("comms", 300)]), ids=lambda cut: f"{cut[0]}-{cut[1]}"
)
def test_a_pe_of_big_blue_is_cut_off_and_mended(cut: tuple[str, int]) -> None:
    pe, cut_ms = cut
    simulation = flying(big_blue(), cut_ms, decide_ns=2 * MS)
    simulation.fleet.cut(pe)
    simulation.run_for(cut_ms * MS)
    simulation.fleet.mend(pe)
    assert simulation.settle() == []


def test_a_driver_that_was_cut_off_does_not_drive_on_the_state_of_a_pe_that_has_restarted() -> None:
    """Its DEMUX has been given away when its wire is mended, and the first it hears is a PE that runs nothing yet."""
    for mended_ms in sample(range(4, 20, 2), 3):
        simulation = flying(two_tails(), 36, decide_ns=2 * MS)
        simulation.fleet.cut("tail_pe")
        simulation.run_for(30 * MS)
        simulation.fleet.kill("sensor_pe")
        simulation.run_for(170 * MS)
        simulation.fleet.restore("sensor_pe")
        simulation.run_for(mended_ms * MS)
        simulation.fleet.mend("tail_pe")
        simulation.run_for(1 * MS)
        assert simulation.settle() == [], mended_ms


def servo_sticks(simulation: Simulation) -> None:
    """The elevator is driven from the tail, and from `control_pe` as soon as the monitor has noticed."""
    simulation.fail_device("elevator_servo_1", "stuck")


def test_a_pe_that_has_to_stop_driving_has_a_failed_receiver_from_any_message_on() -> None:
    recorded = flying(two_tails(), keep_trace=True, decide_ns=2 * MS)
    servo_sticks(recorded)
    recorded.run_for(10_000 * MS)
    assert [step.step for step in recorded.events_of(events.EpochStep)] == ["GO_ALL", "BREAK", "GO_ALL"]
    known_ns = recorded.events_of(events.FaultReported)[-1].t_ns
    for frame in sample(management_frames(recorded.trace, known_ns, recorded.events_of(events.Reconfigured)[-1].t_ns)):
        simulation = flying(two_tails(), decide_ns=2 * MS)
        at_end_of(simulation, frame, lambda flight=simulation: fail_receiver(flight, "tail_pe", 150 * MS))
        servo_sticks(simulation)
        simulation.run_until(frame.end_ns + 150 * MS)
        assert simulation.settle() == [], frame


def test_a_pe_whose_receiver_stays_failed_is_failed_although_it_sends() -> None:
    simulation = flying(two_tails(), decide_ns=2 * MS)
    simulation.fleet.kill("sensor_pe")
    fail_receiver(simulation, "tail_pe", 1_000 * MS)
    simulation.run_for(1_000 * MS)
    assert simulation.events_of(events.PeLost)[-1].cause == "it hears no lease"
    assert simulation.settle() == []
