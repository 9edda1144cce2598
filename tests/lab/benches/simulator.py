"""How many seconds of flight the simulator computes in one second of processor time.

Data plane, modules and oracles all run. Planning is left out, since a campaign has few different requests, and has a
figure of its own. Where `heronry sim --compiled` has compiled these sources, the compiled form is measured as well.
"""

import subprocess
import sys
import time
from argparse import Namespace

from heronry_dg.shipped import shipped_spec_names
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.compiled.machine_code import compiled_folder, environment, is_compiled
from heronry_tools.sim.flight.campaign import collect_seldom
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.planning import plans_known
from lab.benches.harness import Benchmark, Report, seconds_option

_NS_PER_S = 1_000_000_000


def measure(arguments: Namespace, report: Report) -> None:
    """Fly every shipped spec; then again, compiled."""
    collect_seldom()
    for name in shipped_spec_names():
        _measure(name, round(arguments.seconds * _NS_PER_S), report)
    if is_compiled():
        return
    folder = compiled_folder()
    if folder.is_dir():
        again = [sys.executable, "-P", "-m", "lab.benches.simulator", *arguments.words]
        subprocess.run(again, env=environment(folder), check=True)
    else:
        report.lines(["compiled: not made yet; heronry sim big_blue --compiled makes it"])


def _measure(name: str, duration_ns: int, report: Report) -> None:
    simulation = Simulation(load_spec(name))
    begun_s = time.process_time()
    simulation.settle()
    start_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.wiring.buses.values())
    begun_s = time.process_time()
    simulation.run_for(duration_ns)
    used_s = time.process_time() - begun_s
    frames = sum(bus.frames for bus in simulation.wiring.buses.values()) - frames
    report.begin(f"{'compiled' if is_compiled() else 'Python'}: {name}")
    report.figures(
        "  {times_real_time:.1f} x real time, {frames_per_s:.0f} frames/s, {us_per_frame:.1f} us a frame; "
        "start-up {start_up_s:.2f} s with {plans} plan(s)",
        times_real_time=duration_ns / _NS_PER_S / used_s,
        frames_per_s=frames * _NS_PER_S / duration_ns,
        us_per_frame=1e6 * used_s / frames,
        start_up_s=start_s,
        plans=plans_known(),
    )


main = Benchmark("simulator", __doc__, measure, seconds_option(20.0, "of flight"))
if __name__ == "__main__":
    sys.exit(main())
