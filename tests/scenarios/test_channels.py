"""The loss of one channel of a replicated bus, at any moment and on any PE, changes only the reports."""

import pytest

from heronry_manager import events
from heronry_manager.events.line import to_object
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation
from heronry_wire.identifiers import emcy_id
from scenarios.flights import MS, flying, twin_wires
from thoroughness import mostly_soak

REPORT = (events.ChannelLost, events.ChannelBack)
LOSS = "1 crash pe:rear for 2"
PULLED = [
    "0.5 channel_loss channel:can0.1 for 5",
    "0.5 channel_loss channel:can0.2 for 5",
    "0.5 channel_loss channel:can1.1 for 5",
    "1.07 channel_loss channel:can0.1 for 1",
    "3 channel_loss channel:can0.2 for 0.3",
    "0.5 half_cut pe:front for 3 level 1",
    "0.5 half_cut pe:tail for 3 level 2",
]


def flight(*faults: str) -> Simulation:
    simulation = flying(twin_wires(), keep_trace=True)
    Injections(simulation, tuple(read_fault(twin_wires(), fault) for fault in (LOSS, *faults)), simulation.now_ns)
    simulation.run_for(8_000 * MS)
    return simulation


def story(simulation: Simulation) -> list[dict[str, object]]:
    """Events of the manager except the reports of channels, without times."""
    timeless = ("t_ns", "times_ns", "decide_ns", "last_heard_ns", "silent_ns", "plan")
    return [
        {key: value for key, value in to_object(event).items() if key not in timeless}
        for event in simulation.events
        if not isinstance(event, REPORT)
    ]


@pytest.fixture(scope="module")
def untouched() -> Simulation:
    return flight()


@pytest.mark.parametrize("pull", mostly_soak(PULLED, [PULLED[0], PULLED[-1]]))
def test_a_flight_with_a_channel_pulled_is_the_same_flight(untouched: Simulation, pull: str) -> None:
    pulled = flight(pull)
    assert story(pulled) == story(untouched)
    assert {type(e) for e in pulled.events} - {type(e) for e in untouched.events} == set(REPORT)
    assert pulled.broken() == []
    assert pulled.settle() == []


def test_without_a_fault_both_channels_carry_the_same_and_no_pe_reports_anything(untouched: Simulation) -> None:
    for first, second in untouched.wiring.wires.values():
        assert (first.frames, first.busy_bits) == (second.frames, second.busy_bits)
    emergencies = {emcy_id(pe.node_id) for pe in untouched.spec.pes.values()}
    assert not any(sent.frame.can_id in emergencies for sent in untouched.trace)
    assert len(untouched.trace) == sum(bus.frames for bus in untouched.wiring.buses.values())


def test_the_same_seed_gives_the_same_frames_on_both_channels() -> None:
    assert flight(PULLED[0]).digest() == flight(PULLED[0]).digest()


def test_a_manager_that_is_new_knows_within_a_second_what_is_lost() -> None:
    simulation = flying(twin_wires())
    simulation.break_channel("can0.2")
    simulation.run_for(500 * MS)
    simulation.managers.kill()
    simulation.managers.start()
    simulation.run_for(1_500 * MS)
    manager = simulation.managers.foremost
    assert manager is not None
    assert manager.core.status()["channels"]["can0.2"] == ["the manager", "front", "rear", "tail"]


def test_a_pe_that_starts_on_one_channel_is_available_and_reports_the_other() -> None:
    simulation = flying(twin_wires())
    simulation.break_channel("can0.1")
    simulation.fleet.kill("rear")
    simulation.run_for(500 * MS)
    simulation.fleet.restore("rear")
    simulation.run_for(2_000 * MS)
    assert simulation.events_of(events.PeJoined)[-1].pe == "rear"
    assert [e.by for e in simulation.events_of(events.ChannelLost)].count("rear") >= 1
    assert simulation.unsettled() == []


def test_a_paused_pe_takes_what_came_meanwhile_once() -> None:
    simulation = flying(twin_wires())
    for pe in simulation.fleet.running.values():
        pe.pause(300 * MS)
    manager = simulation.managers.foremost
    assert manager is not None
    manager.pause(120 * MS)
    simulation.break_channel("can0.1")
    simulation.run_for(2_000 * MS)
    simulation.mend_channel("can0.1")
    assert simulation.settle() == []
