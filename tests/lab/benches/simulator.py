"""Measure the simulator: `python -m lab.benches.simulator`.

How many seconds of flight go by in one second of this processor, with everything running: data plane, modules, checks.
Planning is not counted, since a campaign asks few different questions; it is told apart. Where the compiled form of
these sources has been made (`heronry sim --compiled` does), it is measured as well.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.console.errors import exit_code
from heronry_tools.sim.compiled.machine_code import compiled_folder, environment, is_compiled
from heronry_tools.sim.flight.campaign import collect_seldom
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.planning import plans_known

_NS_PER_S = 1_000_000_000


def main(argv: Sequence[str] | None = None) -> None:
    """Run the benchmark and print its figures."""
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(prog="python -m lab.benches.simulator", description="Measure the simulator.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of flight (default: 20)")
    options = parser.parse_args(argv)
    collect_seldom()
    for name in shipped_spec_names():
        print(_measured(name, round(options.seconds * _NS_PER_S)), flush=True)
    if is_compiled():
        return
    folder = compiled_folder()
    if folder.is_dir():
        again = [sys.executable, "-P", "-m", "lab.benches.simulator", *argv]
        subprocess.run(again, env=environment(folder), check=True)
    else:
        print("compiled: not made yet; heronry sim big_blue --compiled makes it")


def _measured(name: str, duration_ns: int) -> str:
    simulation = Simulation(load(shipped_spec_path(name)))
    begun_s = time.process_time()
    simulation.settle()
    start_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.wiring.buses.values())
    begun_s = time.process_time()
    simulation.run_for(duration_ns)
    used_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.wiring.buses.values()) - frames
    seconds = duration_ns / _NS_PER_S
    return (
        f"{'compiled' if is_compiled() else 'Python'}: {name} {seconds / used_s:.1f} x real time, "
        f"{frames / seconds:.0f} frames/s, {1e6 * used_s / frames:.1f} us a frame; "
        f"start-up {start_s:.2f} s with {plans_known()} plan(s)"
    )


if __name__ == "__main__":
    sys.exit(exit_code(main, "bench"))
