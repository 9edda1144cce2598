"""A second PE dies while the reconfiguration for the first is under way: at drawn offsets, and at every single message.

The first flight is recorded; then it is flown again, once for every command, state and emergency frame between the
moment at which the loss is known and the end of the reconfiguration, and at the end of that frame another PE dies.
"""

from collections.abc import Callable
from random import Random

import pytest

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent
from scenarios.flights import MS, at_end_of, big_blue, flying, management_frames, times_are_told, two_tails
from thoroughness import mostly_soak, sample

BEAT_NS = 20 * MS


TOGETHER = [("flight", "nav"), ("tail_a", "tail_b"), ("payload", "flight"), ("comms", "wing"), ("nav", "ground")]


@pytest.mark.parametrize("pair", mostly_soak(TOGETHER, [("flight", "nav")]), ids="-".join)
def test_two_die_within_one_heartbeat(pair: tuple[str, str]) -> None:
    first, second = pair
    offset_ns = Random(f"{first}{second}").randrange(BEAT_NS)
    simulation = flying(big_blue())
    simulation.fleet.kill(first)
    simulation.run_for(offset_ns)
    simulation.fleet.kill(second)
    assert simulation.settle() == []
    times_are_told(simulation)
    simulation.fleet.restore(second)
    simulation.fleet.restore(first)
    assert simulation.settle() == []


def loses_tail(simulation: Simulation) -> type[events.Event]:
    simulation.fleet.kill("tail_pe")
    return events.PeLost


def gets_tail_back(simulation: Simulation) -> type[events.Event]:
    simulation.fleet.kill("tail_pe")
    simulation.run_for(500 * MS)
    simulation.fleet.restore("tail_pe")
    return events.PeJoined


def servo_sticks(simulation: Simulation) -> type[events.Event]:
    simulation.run_for(5_000 * MS)
    simulation.fail_device("elevator_servo_1", "stuck")
    return events.FaultReported


Story = Callable[[Simulation], type[events.Event]]


def frames_of(spec: Spec, story: Story) -> list[Sent]:
    """Management frames of the reconfiguration that a story brings about."""
    simulation = flying(spec, keep_trace=True)
    begins = story(simulation)
    simulation.run_for(15_000 * MS if begins is events.FaultReported else 1_000 * MS)
    known_ns = simulation.events_of(begins)[-1].t_ns
    done_ns = simulation.events_of(events.Reconfigured)[-1].t_ns
    assert done_ns > known_ns
    return management_frames(simulation.trace, known_ns, done_ns)


def flown_again(spec: Spec, story: Story, until: Sent, what: Callable[[Simulation], None]) -> Simulation:
    """The same flight, with something done at the end of one of its frames."""
    simulation = flying(spec)
    at_end_of(simulation, until, lambda: what(simulation))
    story(simulation)
    simulation.run_until(until.end_ns + 1)
    return simulation


@pytest.mark.parametrize("second", ["sensor_pe", "control_pe"])
@pytest.mark.parametrize("story", [loses_tail, gets_tail_back])
def test_a_second_pe_dies_at_the_end_of_every_message(story: Story, second: str) -> None:
    frames = frames_of(two_tails(), story)
    assert len(frames) > 10
    wrong = {}
    for frame in sample(frames, 9):
        simulation = flown_again(two_tails(), story, frame, lambda flight: flight.fleet.kill(second))
        assert second not in simulation.fleet.running
        violations = simulation.settle()
        if violations:
            wrong[frame] = violations
        times_are_told(simulation)
    assert wrong == {}


def test_the_pe_that_comes_back_dies_again_at_the_end_of_every_message() -> None:
    wrong = {}
    for frame in sample(frames_of(two_tails(), gets_tail_back)):
        simulation = flown_again(two_tails(), gets_tail_back, frame, lambda flight: flight.fleet.kill("tail_pe"))
        violations = simulation.settle()
        if violations:
            wrong[frame] = violations
    assert wrong == {}


def test_a_second_pe_dies_at_some_messages_while_the_servos_change_over() -> None:
    wrong = {}
    for frame in sample(frames_of(two_tails(), servo_sticks)[::6], 9):
        simulation = flown_again(two_tails(), servo_sticks, frame, lambda flight: flight.fleet.kill("control_pe"))
        violations = simulation.settle()
        if violations:
            wrong[frame] = violations
    assert wrong == {}


@pytest.mark.soak
@pytest.mark.parametrize(("first", "second"), [("flight", "nav"), ("tail_a", "comms"), ("payload", "tail_b")])
def test_a_second_pe_of_big_blue_dies_at_some_messages(first: str, second: str) -> None:
    def story(simulation: Simulation) -> type[events.Event]:
        simulation.fleet.kill(first)
        return events.PeLost

    frames = frames_of(big_blue(), story)
    wrong = {}
    for frame in Random(first).sample(frames, 4):
        simulation = flown_again(big_blue(), story, frame, lambda flight: flight.fleet.kill(second))
        violations = simulation.settle()
        if violations:
            wrong[frame] = violations
    assert wrong == {}
