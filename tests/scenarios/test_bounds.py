"""No reconfiguration in flight takes longer than its bound, and no bound is far above what reconfigurations take."""

from collections.abc import Callable, Iterator
from functools import cache
from itertools import takewhile

import pytest

from heronry_agent.core.step_times import HUNG_NS
from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.bounds.fault_cases import fault_cases
from heronry_manager.bounds.reconfiguration_bound import Bound, Bounds, FaultClass
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import DEFAULT_DECIDE_NS, Simulation
from heronry_tools.sim.world.planning import best_plan
from scenarios.flights import MS, big_blue, elevator_and_chute, flying, two_tails
from scenarios.test_single_faults import with_a_twin_of_what_raises
from thoroughness import mostly_soak, part_of

_EMCY_NS = 100_000  # at least

SPECS: dict[str, Callable[[], Spec]] = {
    "big_blue": big_blue,
    "elevator_and_chute": elevator_and_chute,
    "raising": with_a_twin_of_what_raises,
    "two_tails": two_tails,
}


@cache
def bounds_of(name: str) -> dict[tuple[FaultClass, str], Bound]:
    spec = SPECS[name]()

    def plan(now: Situation, running: Placement | None) -> Configuration:
        return best_plan(spec, now, running).configuration

    limits = Bounds(spec)
    cases = fault_cases(spec, spec.initial_phase(), plan)
    if name == "big_blue":  # no module of it is made to report: those plans are not made either
        cases = takewhile(lambda case: case.fault is not FaultClass.DEVICE_REPORTED, cases)
    return {(case.fault, case.element): limits.bound(case, DEFAULT_DECIDE_NS) for case in cases}


def bound_ns(name: str, fault: FaultClass, element: str) -> int:
    total_ns = bounds_of(name)[fault, element].total_ns
    assert total_ns is not None, bounds_of(name)[fault, element]
    return total_ns


def taken_ns(simulation: Simulation, since_ns: int) -> int:
    """Time from an instant to the last reconfiguration that followed it, in ns."""
    done = [told.t_ns for told in simulation.events_of(events.Reconfigured) if told.t_ns > since_ns]
    return max(done, default=since_ns) - since_ns


def lost_cut_off_and_back(name: str, pe: str, seed: int) -> Iterator[tuple[FaultClass, int]]:
    """Times that it takes when a PE dies, when it comes back, and when it is cut off in another flight, in ns."""
    simulation = flying(SPECS[name](), seed)
    longest_ns = 2 * bound_ns(name, FaultClass.PE_RETURNS, f"pe:{pe}")
    killed_ns = simulation.now_ns + seed * 7 * MS
    simulation.run_until(killed_ns)
    simulation.fleet.kill(pe)
    simulation.run_for(longest_ns)
    yield FaultClass.PE_LOST, taken_ns(simulation, killed_ns)
    back_ns = simulation.now_ns
    simulation.fleet.restore(pe)
    simulation.run_for(longest_ns)
    yield FaultClass.PE_RETURNS, taken_ns(simulation, back_ns)
    other = flying(SPECS[name](), seed + 100)
    cut_ns = other.now_ns
    other.fleet.cut(pe)
    other.run_for(longest_ns)
    yield FaultClass.PARTITION, taken_ns(other, cut_ns)


LOST = [
    ("elevator_and_chute", "sensor_pe"),
    ("elevator_and_chute", "control_pe"),
    ("elevator_and_chute", "tail_pe"),
    ("two_tails", "tail_pe"),
    ("big_blue", "flight"),
    ("big_blue", "nav"),
    ("big_blue", "tail_b"),
    ("big_blue", "comms"),
]


@pytest.mark.parametrize("lost", mostly_soak(LOST, LOST[1:4]), ids="-".join)
def test_a_reconfiguration_for_a_pe_that_is_lost_cut_off_or_back_ends_within_the_bound(lost: tuple[str, str]) -> None:
    name, pe = lost
    longest: dict[FaultClass, int] = {}
    for seed in range(part_of(2, 2)):
        for fault, ns in lost_cut_off_and_back(name, pe, seed):
            assert ns <= bound_ns(name, fault, f"pe:{pe}"), (fault, seed)
            longest[fault] = max(longest.get(fault, 0), ns)
    if pe != "comms":  # beyond which another PE is missed much later
        assert bound_ns(name, FaultClass.PE_LOST, f"pe:{pe}") < 2 * longest[FaultClass.PE_LOST]
        assert bound_ns(name, FaultClass.PE_RETURNS, f"pe:{pe}") < 2 * longest[FaultClass.PE_RETURNS]


PERIOD_MS, LEASE_MS = 20, 100
SILENCE_MS = PERIOD_MS * 13 // 4
RESTARTS_MS = 100  # two
STEP_MS, PERIOD_OF_STEPS_MS = 30, 25


@pytest.mark.parametrize(
    ("fault", "fault_class", "more_ms"),
    [
        (Fault(0, "mute", "pe:tail_pe", 1000), FaultClass.PE_LOST, 0),
        (Fault(0, "pause", "pe:tail_pe", 1000), FaultClass.PE_LOST, 0),
        (Fault(0, "bus_off", "pe:tail_pe"), FaultClass.PE_LOST, 0),
        (Fault(0, "deaf", "pe:tail_pe", 1000), FaultClass.PE_LOST, 2 * LEASE_MS + 2 * PERIOD_MS - SILENCE_MS),
        (Fault(0, "twin", "pe:sensor_pe", 60), FaultClass.PE_LOST, -SILENCE_MS),
        (
            Fault(0, "overrun", "module:servo_driver_1", 1000),
            FaultClass.MODULE_REPORTED,
            PERIOD_OF_STEPS_MS + 10 * STEP_MS,
        ),
        (Fault(0, "raise", "module:servo_driver_1"), FaultClass.MODULE_REPORTED, 3 * PERIOD_OF_STEPS_MS + RESTARTS_MS),
        (
            Fault(0, "stuck", "pe:tail_pe", 1000),
            FaultClass.MODULE_REPORTED,
            3 * (PERIOD_OF_STEPS_MS + HUNG_NS // MS) + RESTARTS_MS,
        ),
    ],
    ids=lambda value: value.kind if isinstance(value, Fault) else "",
)
def test_a_fault_takes_no_longer_than_failure_modes_say(fault: Fault, fault_class: FaultClass, more_ms: int) -> None:
    element = "module:servo_driver_1" if fault_class is FaultClass.MODULE_REPORTED else fault.target
    longest_ns = bound_ns("two_tails", fault_class, element) + more_ms * MS
    took_ns = []
    for seed in range(2):
        simulation = flying(two_tails(), seed)
        simulation.run_for(seed * 7 * MS)
        injected_ns = simulation.now_ns
        Injections(simulation, (fault,), injected_ns)
        simulation.run_for(longest_ns)
        took_ns.append(taken_ns(simulation, injected_ns))
    assert all(took_ns)
    assert 2 * max(took_ns) > longest_ns


def test_a_reconfiguration_for_a_radio_that_is_lost_ends_within_the_bound() -> None:
    simulation = flying(big_blue())
    cut_ns = simulation.now_ns
    simulation.fleet.cut("ground")  # no other PE is on that radio
    simulation.run_for(3_000 * MS)
    took_ns = taken_ns(simulation, cut_ns)
    assert 0 < took_ns <= bound_ns("big_blue", FaultClass.BUS_LOST, "bus:radio") < 2 * took_ns
    gateway = bounds_of("big_blue")[FaultClass.BUS_LOST, "pe:comms"]
    assert set(gateway.case.silent) == {"comms", "ground"}


def reported_ns(simulation: Simulation) -> int:
    """Time from the first bit of the EMCY to the end of the reconfiguration that it brought about, in ns."""
    heard_ns = simulation.events_of(events.FaultReported)[0].t_ns
    return taken_ns(simulation, heard_ns - _EMCY_NS)


def test_a_reconfiguration_for_a_device_that_is_reported_ends_within_the_bound() -> None:
    simulation = flying(two_tails())
    simulation.fail_device("elevator_servo_1", "stuck")
    while not simulation.events_of(events.FaultReported):
        simulation.run_for(50 * MS)
    simulation.run_for(500 * MS)
    longest_ns = bound_ns("two_tails", FaultClass.DEVICE_REPORTED, "device:elevator_servo_1")
    assert 0 < reported_ns(simulation) <= longest_ns < 3 * reported_ns(simulation)


def test_a_reconfiguration_for_a_module_that_raises_ends_within_the_bound() -> None:
    simulation = Simulation(with_a_twin_of_what_raises())
    simulation.run_for(2_500 * MS)  # half a second after it was started it raises
    longest_ns = bound_ns("raising", FaultClass.MODULE_REPORTED, "module:state_estimator")
    assert 0 < reported_ns(simulation) <= longest_ns < 3 * reported_ns(simulation)
