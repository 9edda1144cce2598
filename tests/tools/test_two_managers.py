"""Flights with two managers: their faults, how these are drawn, and how each flight is flown again."""

import json
import shlex
from random import Random

import pytest

from heronry_manager import events
from heronry_tools.cli import main
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.faults.fault import KINDS, MANAGER, read_fault
from heronry_tools.sim.faults.protocol_state import ProtocolState
from heronry_tools.sim.flight.campaign import Coverage
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import Outcome, Scenario, need_key, play
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.terms import TermCheck
from heronry_tools.sim.world.bus import Faults, SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.management import Lease, SliceHead, Step
from heronry_wire.protocol_times import LEASE_PERIODS
from scenarios.flights import KEY, MS, big_blue, two_tails
from thoroughness import mostly_soak

OF_TWO = [name for name, kind in KINDS.items() if kind.of_two]


def flight(*texts: str, seed: int = 1, seconds: float = 2.0) -> Outcome:
    """The outcome of a flight of two_tails with two managers."""
    faults = tuple(read_fault(two_tails(), text) for text in texts)
    return play(two_tails(), Scenario(seed, seconds, faults, standby=True))


def flying(seed: int = 1, key: Key | None = None) -> Simulation:
    simulation = Simulation(two_tails(), seed, standby=True, key=key)
    while not simulation.events_of(events.Reconfigured) or simulation.unsettled():
        simulation.run_for(50 * MS)
    return simulation


# Faults of two managers


@pytest.mark.parametrize("target", mostly_soak(["manager", "primary", "standby"], ["primary"]))
@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.target_kind == MANAGER])
def test_every_fault_of_a_manager_leaves_an_aircraft_that_comes_right_again(kind: str, target: str) -> None:
    outcome = flight(f"0.1 {kind} {target} for 0.4")
    assert outcome.violations == ()
    assert sum(outcome.hits.values()) == 1


@pytest.mark.parametrize(
    ("kind", "level"),
    [
        *(("bus_split bus:can0", ""), ("bus_split bus:can0", " level 1")),
        *(("stale_table pe:tail_pe", ""), ("attack bus:can0", "")),
    ],
)
def test_every_other_fault_of_two_does(kind: str, level: str) -> None:
    outcome = flight(f"0.1 {kind} for 0.6{level}")
    assert outcome.violations == ()
    assert sum(outcome.hits.values()) == 1


def test_a_pe_with_a_stale_table_runs_nothing_until_the_right_one_is_back() -> None:
    simulation = flying()
    injections = Injections(
        simulation, (read_fault(two_tails(), "0 stale_table pe:tail_pe for 0.8"),), simulation.now_ns
    )
    simulation.run_for(700 * MS)
    assert simulation.events_of(events.PeRefused)[-1].reason == "DIGEST"
    assert "pe:tail_pe" in simulation.truth.situation.down
    simulation.run_for(200 * MS)
    assert simulation.truth.situation.down == frozenset()
    injections.heal()
    assert simulation.settle() == []


def test_a_stale_table_outlives_the_death_of_its_pe_and_starts_no_dead_pe() -> None:
    simulation = flying()
    faults = ("0 stale_table pe:tail_pe for 0.4", "0.1 crash pe:tail_pe for 0.1", "0.3 crash pe:tail_pe")
    Injections(simulation, tuple(read_fault(two_tails(), fault) for fault in faults), simulation.now_ns)
    simulation.run_for(250 * MS)
    assert "pe:tail_pe" in simulation.truth.situation.down
    simulation.run_for(350 * MS)
    assert "tail_pe" not in simulation.fleet.running


@pytest.mark.parametrize(("disk", "key", "is_promised"), [("full", KEY, False), ("full", None, True), ("", KEY, True)])
def test_a_manager_with_a_key_that_counts_again_is_taken_for_a_replay(
    disk: str, key: Key | None, *, is_promised: bool
) -> None:
    simulation = flying(key=key)
    faults = ["0.1 crash pe:tail_pe for 0.1", "0.5 manager_crash primary for 0.1"]
    faults += ["0 disk_full primary for 0.7"] if disk else []
    Injections(simulation, tuple(read_fault(two_tails(), fault) for fault in faults), simulation.now_ns)
    simulation.run_for(600 * MS)
    assert simulation.waivers.cover("silence", simulation.now_ns) is not is_promised


def test_a_manager_is_doubled_once_at_most_and_its_double_is_gone_when_the_fault_is_over() -> None:
    simulation = flying()
    faults = (
        "0 manager_double primary for 0.5",
        "0.1 manager_double primary for 0.5",
        "0.2 manager_crash primary for 0.1",
    )
    injections = Injections(simulation, tuple(read_fault(two_tails(), fault) for fault in faults), simulation.now_ns)
    simulation.run_for(150 * MS)
    assert sorted(simulation.managers.running) == [-126, 126, 127]
    assert injections.hits.total() == 1
    simulation.run_for(500 * MS)
    assert sorted(simulation.managers.running) == [126, 127]
    assert simulation.settle() == []


# The bus in two halves


class Halves:
    """Two stations on each side of a bus."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.bus = SimulatedBus("can0", 1_000_000, self.clock, Random(1), Faults())
        self.heard: list[tuple[str, str]] = []
        self.stations = {
            name: self.bus.join(name, 0, lambda e, n=name: self.hear(n, e.frame)) for name in ("a1", "a2", "b1", "b2")
        }

    def hear(self, name: str, frame: Frame) -> None:
        self.heard.append((name, frame.data.decode()))

    def send(self, *names: str) -> None:
        for name in names:
            self.bus.offer(self.stations[name], Frame(0x100, name.encode()))
        self.clock.run_until(self.clock.now_ns + 10 * MS)


def test_two_halves_of_a_bus_do_not_hear_each_other_nor_collide() -> None:
    halves = Halves()
    halves.bus.apart = lambda sender, receiver: sender[0] != receiver[0]
    halves.send("a1", "b1")
    assert sorted(halves.heard) == [("a2", "a1"), ("b2", "b1")]
    assert halves.bus.clashes == []
    halves.bus.apart = None
    halves.heard.clear()
    halves.send("a1")
    assert sorted(name for name, _ in halves.heard) == ["a2", "b1", "b2"]


def test_one_half_may_hear_the_other_that_does_not_hear_it() -> None:
    halves = Halves()
    halves.bus.apart = lambda sender, receiver: sender < receiver and sender[0] != receiver[0]
    halves.send("a1", "b1")
    assert sorted(halves.heard) == [("a1", "b1"), ("a2", "a1"), ("a2", "b1"), ("b2", "b1")]
    assert halves.bus.clashes == []


# Which managers send in a term


def voices(*said: tuple[int, str]) -> list[str]:
    check = TermCheck(two_tails())
    for t_ms, station in said:
        check.follow_alive(t_ms * MS, station, 3)
    return [violation.story for violation in check.violations]


def test_two_of_one_number_that_go_on_in_one_term_are_seen() -> None:
    both = [(t_ms, station) for t_ms in range(0, 400, 20) for station in ("manager 126", "manager 126 again")]
    assert voices(*both) == ["manager 126 and manager 126 again both use term 3"]


def test_with_a_key_two_that_say_the_same_at_once_are_one() -> None:
    check = TermCheck(two_tails(), has_key=True)
    for t_ms in range(0, 2000, 20):
        for station in ("manager 126", "manager 126 again"):
            check.follow_command(t_ms * MS, 126, Lease(3, 0, Step.PREPARED, 0), station)
            check.follow_alive(t_ms * MS, station, 3)
            if station == "manager 126" or t_ms >= 1000:
                check.tagged(t_ms * MS, station)
        assert check.violations == [] or t_ms > 1200
    stories = {violation.story for violation in check.violations}
    assert stories == {"manager 126 and manager 126 again both use term 3"}


def test_one_that_gives_way_soon_and_one_that_speaks_alone_are_well() -> None:
    alone = [(t_ms, "manager 126") for t_ms in range(0, 2000, 20)]
    assert voices(*alone, (60, "manager 126 again"), (80, "manager 126 again")) == []


def test_one_that_the_clash_puts_off_the_bus_for_a_while_has_as_long_again() -> None:
    stations = ("manager 126", "manager 126 again")
    both = [(t_ms, station) for t_ms in (*range(0, 160, 20), *range(240, 440, 20)) for station in stations]
    assert voices(*both) == []
    assert len(voices(*both, *((t_ms, station) for t_ms in (440, 460) for station in stations))) == 1


def test_two_managers_of_one_number_on_two_sides_of_a_broken_bus_meet_when_it_is_mended() -> None:
    check = TermCheck(big_blue())
    for t_ms in range(0, 800, 20):
        if t_ms in (0, 400):
            check.bus_split(t_ms * MS, "can0", t_ms == 0)
        for station in ("manager 126", "manager 126 again"):
            check.follow_alive(t_ms * MS, station, 3)
        assert check.violations == [] or t_ms > 600
    assert len(check.violations) == 1


def test_a_term_that_no_frame_names_any_more_deposes_no_manager() -> None:
    check, lease_ns = TermCheck(two_tails()), LEASE_PERIODS * 20 * MS
    head = SliceHead(94, 3, 0, 0)

    def is_active(t_ns: int, manager: int, term: int) -> bool:
        named = check.follow_command(t_ns, manager, Lease(term, 0, Step.PREPARED, 0), f"manager {manager}")
        assert check.follow_command(t_ns, manager, head, f"manager {manager}") == named
        return named

    assert is_active(1, 127, 6)
    assert is_active(2, 126, 7)
    assert not is_active(2 + lease_ns, 127, 6)
    assert is_active(3 + lease_ns, 127, 6)
    assert check.violations == []


def test_with_a_key_a_term_deposes_no_manager_before_every_node_can_authenticate_it() -> None:
    check, head = TermCheck(two_tails(), has_key=True), SliceHead(94, 3, 0, 0)

    def is_active(t_ms: int, manager: int, term: int) -> bool:
        return check.follow_command(t_ms * MS, manager, Lease(term, 0, Step.PREPARED, 0), f"manager {manager}")

    check.tagged(0, "manager 126")  # of something that was not heard
    assert is_active(1, 126, 1)
    check.tagged(1 * MS, "manager 126")
    assert not check.follow_alive(2 * MS, "manager 126", 1)  # not yet to be believed by all
    check.tagged(21 * MS, "manager 126")
    assert check.follow_alive(22 * MS, "manager 126", 1)
    assert is_active(30, 127, 2)
    assert check.follow_command(30 * MS, 127, head, "manager 127")
    assert is_active(40, 126, 1)
    check.tagged(41 * MS, "manager 126")
    check.tagged(42 * MS, "manager 127")
    check.tagged(45 * MS, "manager 127")  # it answers
    assert is_active(50, 126, 1)
    assert is_active(52, 127, 2)
    check.tagged(52 * MS, "manager 127")
    assert not is_active(53, 126, 1)
    assert is_active(54, 127, 2)
    assert check.violations == []


# What is drawn, and what it reaches


def test_a_fault_of_two_managers_is_drawn_where_there_are_two_and_can_be_given_anywhere() -> None:
    one = {fault.kind for seed in range(30) for fault in drawn_faults(big_blue(), seed, 60.0)}
    two = {fault.kind for seed in range(30) for fault in drawn_faults(big_blue(), seed, 60.0, of_two=True)}
    assert one.isdisjoint(OF_TWO)
    assert two >= set(OF_TWO)
    assert "forge" not in two
    assert {fault.kind for fault in drawn_faults(big_blue(), 1, 60.0, ["disk_full"])} >= {"disk_full"}


def test_faults_go_into_either_manager_and_the_active_one_and_more_often_than_elsewhere() -> None:
    faults = [fault for seed in range(20) for fault in drawn_faults(two_tails(), seed, 60.0, of_two=True)]
    targets = [fault.target for fault in faults]
    assert {"manager", "primary", "standby"} <= set(targets)
    assert all(read_fault(two_tails(), str(fault)) == fault for fault in faults)
    assert "orphaned" in {fault.during for fault in faults}


def test_the_table_of_two_has_a_row_for_everything_that_is_drawn() -> None:
    table = Coverage(two_tails(), of_two=True)
    table.add(flight("0.1 manager_pause manager for 0.3"))
    rows = {line.split()[0] for line in table.table()}
    assert set(OF_TWO) <= rows
    assert ("disk_full", "orphaned") in table.cells()


def test_the_state_of_the_protocol_knows_that_no_manager_is_active() -> None:
    protocol = ProtocolState(Clock())
    protocol.take(events.PlanRequested(1, 1, (), {}, None, ("first",)))
    protocol.set_active_manager(is_heard=False)
    protocol.set_active_manager(is_heard=False)
    assert (protocol.now, protocol.entered["orphaned"]) == ("orphaned", 1)
    protocol.set_active_manager(is_heard=True)
    assert protocol.now == "planning"
    protocol.take(events.TakenOver(1, 2, 1, None, None))
    assert protocol.now == "idle"


def test_a_flight_with_an_attacker_has_a_key() -> None:
    attack = read_fault(two_tails(), "0.1 attack bus:can0 for 0.1")
    assert need_key((attack,))
    assert not need_key(())


# The command


def test_a_campaign_of_two_is_told_so_that_each_flight_can_be_flown_again(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["sim", "elevator_and_chute", "--standby", "--seed", "5", "--runs", "2", "--seconds", "3", "--json"]) == 0
    )
    *flights, whole = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {cell["kind"] for cell in whole["coverage"]["cells"]} >= set(OF_TWO)
    program, *words = shlex.split(flights[1]["replay"])
    assert (program, words[-1]) == ("heronry", "--standby")
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == flights[1]
