"""Every frame of a reconfiguration, one at a time, lost to all nodes, missed by one receiver, or received twice.

CAN sends a destroyed frame again and is not an atomic broadcast: what one node has received another may have missed, or
have twice. Whatever happens to any one command, state or emergency frame, the end is the same.
"""

import pytest

from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent, Tampering
from scenarios.flights import MS, flying, management_frames, times_are_told, two_tails
from thoroughness import sample


def lose_and_regain(simulation: Simulation) -> None:
    """The tail dies, and comes back: the DEMUX is held, then broken and made again."""
    simulation.fleet.kill("tail_pe")
    simulation.run_for(300 * MS)
    simulation.fleet.restore("tail_pe")
    simulation.run_for(300 * MS)


def frames() -> list[Sent]:
    """Management frames of both reconfigurations."""
    simulation = flying(two_tails(), keep_trace=True)
    lose_and_regain(simulation)
    assert len(simulation.events_of(events.Reconfigured)) == 3
    found = []
    for begins, done in zip(
        (events.PeLost, events.PeJoined), simulation.events_of(events.Reconfigured)[1:], strict=True
    ):
        known_ns = simulation.events_of(begins)[-1].t_ns
        found += management_frames(simulation.trace, known_ns, done.t_ns)
    return found


def end_of(frame: Sent, tampering: Tampering) -> list[object]:
    """What is wrong at the end of a flight in which one frame was tampered with."""
    simulation = flying(two_tails())
    simulation.wiring.tamper(frame, tampering)
    lose_and_regain(simulation)
    violations = simulation.settle()
    times_are_told(simulation)
    return list(violations)


@pytest.mark.parametrize("copies", [0, 2], ids=["lost", "doubled"])
def test_a_frame_is_lost_to_all_nodes_or_received_twice(copies: int) -> None:
    wrong = {frame: found for frame in sample(frames(), 8) if (found := end_of(frame, Tampering(copies)))}
    assert wrong == {}


@pytest.mark.parametrize("receiver", ["sensor_pe", "control_pe", "tail_pe", "manager 126"])
def test_a_frame_is_missed_by_one_receiver_alone(receiver: str) -> None:
    aimed = sample([frame for frame in frames() if frame.sender != receiver], 8)
    wrong = {frame: found for frame in aimed if (found := end_of(frame, Tampering(0, receiver)))}
    assert wrong == {}
