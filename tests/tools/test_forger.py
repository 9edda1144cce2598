"""Flights with a key, and an attacker on the bus without it."""

from random import Random

import pytest

from heronry_manager import events
from heronry_manager.core.intake.inbound import Inbound
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.faults.forger import Forger
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_wire.authentication import Key
from heronry_wire.management import decode_emergency

SPEC = load_spec("elevator_and_chute")
FAULTS = ("0.1 attack bus:can0 for 3", "0.5 crash pe:tail_pe for 0.6", "1.5 manager_crash manager for 0.3")


@pytest.mark.parametrize("seed", [1, 2])
def test_every_pe_does_what_its_managers_have_sent_whatever_an_attacker_sends(seed: int) -> None:
    outcome = play(SPEC, Scenario(seed, 4.0, tuple(read_fault(SPEC, fault) for fault in FAULTS)))
    assert outcome.violations == ()
    assert outcome.hits.total() == len(FAULTS)


def test_a_manager_that_believes_slander_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def believe(self: Inbound, pe: str, data: bytes) -> None:
        self._reports.emergency(pe, decode_emergency(data))

    monkeypatch.setattr(Inbound, "_emergency", believe)
    outcome = play(SPEC, Scenario(1, 2.0, (read_fault(SPEC, FAULTS[0]),)))
    assert outcome.violations


def test_a_standby_with_the_key_takes_over_and_is_believed() -> None:
    simulation = Simulation(SPEC, 5, key=Key(bytes(32)), standby=True)
    simulation.run_for(3_000 * MS)
    active = {pe.core.followed_manager.manager for pe in simulation.fleet.running.values()}
    simulation.managers.kill()
    simulation.run_for(1_000 * MS)
    assert {pe.core.followed_manager.manager for pe in simulation.fleet.running.values()} == {126, 127} - active
    assert simulation.settle() == []
    assert not simulation.events_of(events.PeLost)


@pytest.mark.parametrize(("key", "accepts"), [(Key(bytes(32)), False), (None, True)])
def test_a_forged_command_is_accepted_only_where_there_is_no_key(key: Key | None, accepts: bool) -> None:
    simulation = Simulation(SPEC, 3, key=key)
    simulation.run_for(2_000 * MS)
    forger = Forger(simulation.clock, simulation.wiring.buses["can0"], Random(1))
    simulation.run_for(1_000 * MS)
    forger.leave()
    assert forger.attacks > 200
    assert any(pe.core.followed_manager.term > 100 for pe in simulation.fleet.running.values()) is accepts
    refused = [pe.core.authenticity.refused.total() for pe in simulation.fleet.running.values() if pe.core.authenticity]
    assert all(count > 100 for count in refused)
