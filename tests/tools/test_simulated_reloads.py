"""Reloads in the simulator: with real cores on simulated buses, and judged by the oracles of both specs."""

from pathlib import Path
from typing import Any

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.epochs.epoch import Epoch
from heronry_tools.cli import main
from heronry_tools.sim.flight.exhaustive import Setup, read_case, single_cases, stories
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent, Tampering
from heronry_tools.sim.world.next_spec import next_spec
from heronry_wire.authentication import Key
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import Activate, Lease, decode_command
from scenarios.flights import KEY, MS, elevator_and_chute

FILE = shipped_spec_path("elevator_and_chute")
CHANGED = Path(__file__).parents[1] / "scenarios" / "elevator_and_chute_changed.dg.yaml"
S = 1_000 * MS


def flying(**more: Any) -> Simulation:
    """An aircraft that has converged, in which the change can be ordered."""
    simulation = Simulation(elevator_and_chute(), following=next_spec(CHANGED), **more)
    simulation.run_for(8 * S)
    assert simulation.broken() + simulation.unsettled() == []
    return simulation


def reload(simulation: Simulation) -> None:
    assert simulation.reloads is not None
    simulation.reloads.order()
    simulation.reloads.fly_through()


def is_reloaded(simulation: Simulation) -> bool:
    assert simulation.reloads is not None
    return simulation.reloads.is_done


@pytest.mark.parametrize("standby", [False, True])
@pytest.mark.parametrize("key", [None, KEY], ids=["without a key", "with a key"])
def test_the_aircraft_changes_to_the_other_spec(key: Key | None, standby: bool) -> None:
    simulation = flying(key=key, standby=standby)
    reload(simulation)
    assert is_reloaded(simulation)
    assert simulation.settle() == []
    assert simulation.checks.missed_steps([]) == []
    assert simulation.checks.spec.digest == load(CHANGED).digest
    assert {pe.core.table.spec_digest for pe in simulation.fleet.running.values()} == {load(CHANGED).digest}


def activations(simulation: Simulation) -> list[int]:
    """Return the list to which the number of each epoch is added when it is activated."""
    found: list[int] = []

    def see(sent: Sent) -> None:
        if sent.frame.can_id == management_id(126, Command.ACTIVATE):
            message = decode_command(Command.ACTIVATE, sent.frame.data)
            assert isinstance(message, Activate)
            found.append(message.epoch)

    simulation.wiring.tap(simulation.spec.manager.bus, see)
    return found


def test_a_manager_that_does_not_wait_for_a_pe_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = flying()
    first = simulation.checks.epoch

    def lose(sent: Sent) -> Tampering | None:
        """Lose, for one PE, every step of the epochs that follow."""
        for command in (Command.ACTIVATE, Command.LEASE):
            if sent.frame.can_id == management_id(126, command):
                message = decode_command(command, sent.frame.data)
                assert isinstance(message, Activate | Lease)
                return Tampering(0, "control_pe") if message.epoch != first else None
        return None

    simulation.wiring.buses[simulation.spec.manager.bus].tamper = lose
    monkeypatch.setattr(Epoch, "all_broken", lambda _: True)
    reload(simulation)
    simulation.run_for(5 * S)
    assert "mixture" in {violation.rule for violation in simulation.broken()}


def test_a_manager_that_dies_between_the_steps_takes_all_pes_back() -> None:
    simulation = flying()
    activated = activations(simulation)
    assert simulation.reloads is not None
    simulation.reloads.order()
    while not activated:
        simulation.run_for(MS)
    simulation.managers.kill()
    simulation.run_for(300 * MS)
    simulation.managers.start()
    assert simulation.settle() == []
    assert not is_reloaded(simulation)
    assert simulation.checks.spec.digest == elevator_and_chute().digest


def test_drawn_flights_change_or_keep_the_old_spec() -> None:
    outcome = play(elevator_and_chute(), Scenario(1, 12, (), reload=CHANGED))
    assert (outcome.reloaded, outcome.violations) == ("reloaded", ())


def test_the_reload_is_one_story_with_every_fault_at_every_frame() -> None:
    spec, setup = elevator_and_chute(), Setup(reload=CHANGED)
    assert stories(spec, setup) == ["reload"]
    cases = single_cases(spec, "reload", setup)
    kinds = {fault.kind for case in cases for fault in case.faults}
    assert kinds == {"lost", "doubled", "late-2", "late-30", "crash", "death", "cut"}
    assert read_case(spec, str(cases[0]), setup).faults == cases[0].faults


def test_what_cannot_follow_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.dg.yaml"
    for text, reason in (
        (FILE.read_text(), "flies by this spec already"),
        (CHANGED.read_text().replace("tail_pe", "aft_pe"), "pe:aft_pe, pe:tail_pe"),
    ):
        other.write_text(text)
        assert main(["sim", str(FILE), "--reload", str(other)]) == 2
        assert reason in capsys.readouterr().err
        other = tmp_path / "another.dg.yaml"
    assert main(["exhaust", str(FILE), "--reload", str(tmp_path / "none.dg.yaml"), "--sample", "1"]) == 2


def test_the_second_manager_goes_on_in_command_with_the_other_spec() -> None:
    simulation = flying(standby=True)
    simulation.managers.kill(126)
    simulation.run_for(3 * S)
    reload(simulation)
    assert is_reloaded(simulation)
    assert simulation.settle() == []
    assert simulation.checks.missed_steps([]) == []
