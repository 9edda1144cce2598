"""How fast the aircraft switches to what was foreseen: python -m heronry_tools.simulator.switch_bench SPEC [--runs N].

Each run kills one PE of a simulated aircraft that flies, at a moment of its own in the heartbeat period, and takes the
times of the reconfiguration that follows: `distribute` and `activate`, which together go from the decision to the last
PE active. A foreign node fills the manager's bus up to a share of its bit rate, below all management, with frames of
8 bytes at drawn distances; the aircraft's own frames come on top. Once with slices sent, once with them on board.
"""

import argparse
from random import Random

from heronry_dg.model import Spec
from heronry_tools.simulator.simulation import MS, Simulation
from heronry_tools.spec_argument import load_spec
from heronry_wire.frame import Frame
from heronry_wire.timing import WORST_BLOCKING_BITS

_FILLER_ID = 1999
_LONGEST_START_NS = 10_000 * MS
_UNTIL_DONE_NS = 800 * MS


def main() -> None:
    """Measure and print, in milliseconds."""
    parser = argparse.ArgumentParser(prog="python -m heronry_tools.simulator.switch_bench", description=__doc__)
    parser.add_argument("spec")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--load", type=float, default=0.5, help="share of the bit rate that is filled (default 0.5)")
    arguments = parser.parse_args()
    spec = load_spec(arguments.spec)
    print("ms: median, p99", "distribute", "activate", "both", sep="\t")
    for faults in (None, 1):
        times = [one for seed in range(arguments.runs) if (one := measured(spec, seed, faults, arguments.load))]
        both = [distribute + activate for distribute, activate in times]
        rows = [[one[0] for one in times], [one[1] for one in times], both]
        what = "slices sent" if faults is None else "on board"
        print(f"{what} ({len(times)} runs)", *map(_median_and_p99, rows), sep="\t")


def measured(spec: Spec, seed: int, faults: int | None, load: float) -> tuple[int, int] | None:
    """Kill a PE; gives distribute and activate in nanoseconds, None where nothing had to be done."""
    simulation = Simulation(spec, seed, contingencies=faults)
    while not simulation.events_of("reconfigured") or simulation.unsettled():
        simulation.run_for(50 * MS)
        if simulation.now_ns > _LONGEST_START_NS:
            return None
    known, random = len(simulation.events_of("reconfigured")), Random(seed)
    _fill(simulation, load, random)
    modules = simulation.events_of("plan_ready")[-1]["plan"]["modules"].values()
    victims = sorted({running["pe"] for running in modules})
    victim = victims[seed % len(victims)]
    simulation.at(simulation.now_ns + 100 * MS + random.randrange(20 * MS), lambda: simulation.kill(victim))
    simulation.run_for(_UNTIL_DONE_NS)
    done = simulation.events_of("reconfigured")[known:]
    return (done[0]["times_ns"]["distribute"], done[0]["times_ns"]["activate"]) if done else None


def _fill(simulation: Simulation, load: float, random: Random) -> None:
    """Let a foreign node fill a bus."""
    bus = simulation.buses[simulation.spec.manager.bus]
    bitrate = simulation.spec.buses[simulation.spec.manager.bus].bitrate
    station = bus.join("filler", 0, lambda _: None, frozenset())
    mean_ns = WORST_BLOCKING_BITS * 1_000_000_000 / (bitrate * load)

    def send() -> None:
        bus.offer(station, Frame(_FILLER_ID, random.randbytes(8)))
        simulation.at(simulation.now_ns + round(random.expovariate(1 / mean_ns)), send)

    simulation.at(simulation.now_ns, send)


def _median_and_p99(values: list[int]) -> str:
    ordered = sorted(values)
    return f"{ordered[len(ordered) // 2] / MS:.2f}, {ordered[len(ordered) * 99 // 100] / MS:.2f}"


if __name__ == "__main__":
    main()
