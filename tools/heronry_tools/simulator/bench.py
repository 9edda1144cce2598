"""Measure the simulator: `python -m heronry_tools.simulator.bench`.

How many seconds of flight go by in one second of this processor, with everything running: data plane, modules, checks.
Planning is not counted, since a campaign asks few different questions; it is told apart.
"""

import argparse
import time

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.simulator.planning import plans_known
from heronry_tools.simulator.simulation import Simulation

_NS_PER_S = 1_000_000_000


def main() -> None:
    """Run the benchmark and print its figures."""
    parser = argparse.ArgumentParser(
        prog="python -m heronry_tools.simulator.bench", description="Measure the simulator."
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="of flight (default: 20)")
    options = parser.parse_args()
    for name in ("elevator_and_chute", "big_blue"):
        _measure(name, round(options.seconds * _NS_PER_S))


def _measure(name: str, duration_ns: int) -> None:
    simulation = Simulation(load(shipped_spec_path(name)))
    begun_s = time.process_time()
    simulation.settle()
    start_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.buses.values())
    begun_s = time.process_time()
    simulation.run_for(duration_ns)
    used_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.buses.values()) - frames
    seconds = duration_ns / _NS_PER_S
    print(
        f"{name}: {seconds / used_s:.1f} x real time, {frames / seconds:.0f} frames/s, "
        f"{1e6 * used_s / frames:.1f} us a frame; start-up {start_s:.2f} s with {plans_known()} plan(s)"
    )


if __name__ == "__main__":
    main()
