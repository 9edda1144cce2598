"""A seed replays a flight bit for bit, and another seed is another flight."""

import subprocess
import sys

from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Faults
from scenarios.flights import MS, flying, two_tails


def flight(seed: int) -> str:
    simulation = Simulation(two_tails(), seed, faults=Faults(0.01, 0.001, 0.001))
    simulation.at(700 * MS, lambda: simulation.fleet.kill("tail_pe"))
    simulation.at(1_100 * MS, lambda: simulation.fleet.restore("tail_pe"))
    simulation.run_until(2_000 * MS)
    return simulation.digest()


def test_the_same_seed_gives_the_same_frames() -> None:
    assert flight(7) == flight(7)


def test_another_seed_gives_other_frames() -> None:
    assert len({flight(seed) for seed in range(5)}) == 5


def test_another_process_gives_the_same_frames() -> None:
    program = "from scenarios.test_replay import flight; print(flight(7))"
    found = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": "tests", "PYTHONHASHSEED": "17"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == flight(7)


def test_watching_a_flight_does_not_change_it() -> None:
    watched, unwatched = flying(two_tails(), keep_trace=True), flying(two_tails())
    assert watched.digest() == unwatched.digest()
    assert len(watched.trace) == sum(bus.frames for bus in watched.wiring.buses.values())
