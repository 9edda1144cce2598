"""False alarms in hours of flight without a fault, and reboots that go unnoticed.

    false alarms    hours of flight in which nothing fails: one frame in a thousand is destroyed, and one in a thousand
                    missed by each receiver, clocks are up to 500 ppm fast or slow, and the manager's processor stands
                    still for 50 ms every two seconds or so. Every loss of a PE and every reconfiguration after the
                    first is false
    reboots         PEs that die and are back before their silence is noticed (within the window of three heartbeats).
                    Each must be noticed within one heartbeat of its return, whatever its phase to the others

The data plane is off: every module has one step in a thousand seconds, so that there is time for hours. Each hour is a
flight of its own, with a seed of its own.

Exit code 1 where an alarm was false, or a reboot was not noticed in time.
"""

import sys
from argparse import ArgumentTypeError, Namespace
from collections import Counter
from dataclasses import dataclass, field, replace
from random import Random

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import processors, whole_number
from heronry_tools.console.spec_files import spec_path
from heronry_tools.sim.compiled.machine_code import go_on_compiled
from heronry_tools.sim.flight.campaign import fly_all
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.bus import Faults
from lab.benches.harness import Benchmark, Report, counted, option, spec_option

LOSS = 1e-3
SKEW_PPM = 500
STALL_NS = 50 * MS
STALL_EVERY_NS = 2_000 * MS
HOUR_NS = 3_600_000 * MS

_ONE_STEP_IN_1000_S = 1  # mHz
_MOST_HOURS = 100_000
_PIECE_NS = 60_000 * MS
_START_NS = 3_000 * MS
_BETWEEN_REBOOTS_NS = 1_500 * MS
_WINDOW_LEFT_NS = 5 * MS  # of the window, so that a PE's first state may still be on its way


@dataclass(slots=True)
class Quiet:
    """The results of a flight in which nothing failed."""

    virtual_ns: int
    frames: int = 0
    stalls: int = 0
    suspected: int = 0
    false: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Reboot:
    """One PE that was away for a moment."""

    pe: str
    away_ns: int
    noticed_ns: int | None  # from the PE's return until the manager noticed the reboot; None: it never did
    heartbeat_ns: int

    @property
    def is_in_time(self) -> bool:
        """Tell whether the manager noticed the reboot within a heartbeat and 2 ms, the time of one or two frames."""
        return self.noticed_ns is not None and self.noticed_ns <= self.heartbeat_ns + 2 * MS


def data_plane_off(spec: Spec) -> Spec:
    """Return the same aircraft with modules of one step in a thousand seconds."""
    modules = {}
    for module in spec.modules.values():
        modes = {mode.name: replace(mode, rate_mhz=_ONE_STEP_IN_1000_S) for mode in module.modes.values()}
        modules[module.name] = replace(module, modes=modes)
    digest = f"{int(spec.digest, 16) ^ 1:064x}"  # another spec: results kept for the first one do not hold for it
    return replace(spec, modules=modules, digest=digest)


def fly_quietly(spec: Spec, flight: tuple[int, int]) -> Quiet:
    """Fly for a time without faults; the seed draws lost frames, drifting clocks and stalls of the manager."""
    seed, duration_ns = flight
    random = Random(f"stalls of {seed}")
    simulation = Simulation(data_plane_off(spec), seed, faults=Faults(LOSS, LOSS), skew_ppm=SKEW_PPM)
    simulation.run_for(_START_NS)
    quiet = Quiet(duration_ns)

    def stall() -> None:
        assert simulation.managers.foremost is not None
        simulation.managers.foremost.pause(STALL_NS)
        quiet.stalls += 1
        simulation.at(simulation.now_ns + round(random.expovariate(1 / STALL_EVERY_NS)), stall)

    known = _counted(simulation)
    simulation.at(simulation.now_ns + STALL_EVERY_NS, stall)
    end_ns = simulation.now_ns + duration_ns
    if known["reconfigured"] != 1:
        quiet.false.append(f"seed {seed}: {known['reconfigured']} reconfigurations during start-up")
    while simulation.now_ns < end_ns:
        simulation.events.clear()
        simulation.run_until(min(end_ns, simulation.now_ns + _PIECE_NS))
        simulation.digest()
        counted = _counted(simulation)
        quiet.suspected += counted["pe_suspected"]
        for lost in simulation.events_of(events.PeLost):
            quiet.false.append(f"seed {seed}: {lost.t_ns / 1e9:.3f} s {lost.kind} {lost.cause}")
        for done in simulation.events_of(events.Reconfigured):
            quiet.false.append(f"seed {seed}: {done.t_ns / 1e9:.3f} s {done.kind}")
    quiet.false += [f"seed {seed}: {violation}" for violation in simulation.broken()]
    quiet.frames = sum(bus.frames for bus in simulation.wiring.buses.values())
    return quiet


def fly_reboots(spec: Spec, seed: int) -> list[Reboot]:
    """Reboot every PE of an aircraft once; the seed draws order, phases and durations."""
    random = Random(f"reboots of {seed}")
    simulation = Simulation(data_plane_off(spec), seed, skew_ppm=SKEW_PPM)
    simulation.run_for(_START_NS)
    return [_reboot(simulation, pe, random) for pe in random.sample(list(spec.pes), len(spec.pes))]


def _reboot(simulation: Simulation, pe: str, random: Random) -> Reboot:
    spec = simulation.spec
    bus = min((spec.buses[name] for name in spec.pes[pe].buses), key=lambda bus: bus.name != spec.manager.bus)
    window_ns = (
        bus.misses - 1
    ) * bus.heartbeat_ns - _WINDOW_LEFT_NS  # one more passes before the PE sends its first state
    simulation.run_for(_BETWEEN_REBOOTS_NS + random.randrange(bus.heartbeat_ns))
    away_ns = random.randrange(100_000, window_ns)
    begun_ns = simulation.now_ns
    simulation.fleet.kill(pe)
    simulation.run_for(away_ns)
    back_ns = simulation.now_ns
    simulation.fleet.restore(pe)
    simulation.run_for(_BETWEEN_REBOOTS_NS)
    known = (e.t_ns for e in simulation.events_of(events.PeLost) if e.pe == pe and e.t_ns >= begun_ns)
    noticed_ns = next(known, None)
    return Reboot(pe, away_ns, None if noticed_ns is None else noticed_ns - back_ns, bus.heartbeat_ns)


def _counted(simulation: Simulation) -> Counter[str]:
    return Counter(event.kind for event in simulation.events)


def measure(arguments: Namespace, report: Report) -> None:
    """Fly, and report false alarms and reboots noticed too late."""
    if arguments.hours == arguments.reboots == 0:
        raise UserError("--hours 0 with --reboots 0 measures nothing; write more than 0 for one of them")
    if arguments.compiled:
        go_on_compiled(arguments.words, "lab.benches.endurance")
    report.begin(arguments.spec)
    _hours(arguments, report)
    _reboots(arguments, report)


def hours(text: str) -> float:
    """Read how many hours to fly; argparse shows the name of this function to the user."""
    number = float(text)
    if not 0 <= number <= _MOST_HOURS:
        raise ArgumentTypeError(f"{text} is not a duration; write 0 to {_MOST_HOURS} hours")
    return number


def _hours(arguments: Namespace, report: Report) -> None:
    whole = Quiet(0)
    left_ns = round(arguments.hours * HOUR_NS)
    flights: list[tuple[int, int]] = []
    while left_ns > 0:
        flights.append((arguments.seed + len(flights), min(left_ns, HOUR_NS)))
        left_ns -= HOUR_NS
    flown = fly_all(spec_path(arguments.spec), flights, arguments.jobs, fly_quietly)
    for quiet in counted("hours", len(flights), flown):
        whole.virtual_ns += quiet.virtual_ns
        whole.frames += quiet.frames
        whole.stalls += quiet.stalls
        whole.suspected += quiet.suspected
        whole.false += quiet.false
    report.figures(
        "  {hours:g} h without a fault, {frames} frames, {loss:g} of them destroyed and missed,\n"
        "  {stalls} stalls of the manager, clocks within {skew_ppm} ppm: {suspected} PEs suspected,\n"
        "  {false_alarms} false alarms",
        hours=whole.virtual_ns / HOUR_NS,
        frames=whole.frames,
        loss=LOSS,
        stalls=whole.stalls,
        skew_ppm=SKEW_PPM,
        suspected=whole.suspected,
        false_alarms=len(whole.false),
    )
    report.lines(f"    {line}" for line in whole.false)
    report.require(not whole.false)


def _reboots(arguments: Namespace, report: Report) -> None:
    each = len(load(spec_path(arguments.spec)).pes)
    seeds = range(arguments.seed, arguments.seed + -(-arguments.reboots // each))
    flown = fly_all(spec_path(arguments.spec), seeds, arguments.jobs, fly_reboots)
    reboots = [one for found in counted("flights with reboots", len(seeds), flown) for one in found]
    if reboots:
        missed = [reboot for reboot in reboots if not reboot.is_in_time]
        report.figures(
            "  {reboots} reboots inside the window: {in_time:.1%} noticed within one heartbeat of the return,\n"
            "  the last one after {longest_heartbeats:.2f} heartbeats",
            reboots=len(reboots),
            in_time=1 - len(missed) / len(reboots),
            longest_heartbeats=max(one.noticed_ns / one.heartbeat_ns for one in reboots if one.noticed_ns is not None),
        )
        report.lines(f"    {reboot}" for reboot in missed)
        report.require(not missed)


main = Benchmark(
    "endurance",
    __doc__,
    measure,
    spec_option("elevator_and_chute"),
    option("--hours", 1.0, "of flight without a fault", hours, "H"),
    option("--reboots", 300, "at least so many", whole_number),
    option("--seed", 0, "of the first flight", whole_number),
    option("--jobs", 1, "flights at a time; 0: one per processor", processors),
    lambda parser: parser.add_argument(
        "--compiled", action="store_true", help="fly machine code of the same source: four times as fast"
    ),
)
if __name__ == "__main__":
    sys.exit(main())
