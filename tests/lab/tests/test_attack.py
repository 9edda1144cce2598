"""A PE with a key accepts no attack, however many there are; and the attacks are no paper tigers."""

import pytest

from heronry_agent.core.authority import OutputAuthorization
from heronry_tools.console.spec_files import load_spec
from heronry_wire.authentication import Key
from heronry_wire.command_tags import CommandVerifier, Held, Refusal
from lab.attack import Attacked, denied, main, management_load


def test_no_attack_is_accepted_and_each_is_counted() -> None:
    attacked = Attacked(load_spec("elevator_and_chute"), seed=7)
    for number in range(5000):
        attacked.attack(attacked.kinds[number % 5])
    assert not attacked.accepted
    assert attacked.refused >= 5000
    assert set(attacked.attacks.values()) == {1000}


def test_attacks_find_a_verifier_that_accepts_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    attacked = Attacked(load_spec("elevator_and_chute"), seed=7)
    find = CommandVerifier._find

    def credulous(self: CommandVerifier, manager: int, data: bytes, arrived_ns: int, nonce: int) -> Held | Refusal:
        held = self._held[manager, data[0] >> 5]
        return held.pop() if held else find(self, manager, data, arrived_ns, nonce)

    monkeypatch.setattr(CommandVerifier, "_find", credulous)
    for number in range(60):
        attacked.attack(attacked.kinds[number % 5])
    assert attacked.accepted.keys() == {
        "forged",
        "replayed",
        "reordered",
        "foreign",
    }  # truncated commands are malformed


@pytest.mark.soak  # the figure is printed by the command, below
def test_a_command_costs_at_most_one_more_frame() -> None:
    spec = load_spec("elevator_and_chute")
    plain, tagged = management_load(spec, None), management_load(spec, Key(bytes(32)))
    assert 1.9 < tagged["can0"] / plain["can0"] < 2.1


def test_the_command_prints_its_figures(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["elevator_and_chute", "--count", "500"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["forged", "100", "attacks,", "0", "accepted", "or", "not", "counted"]
    assert lines[-1].startswith("can0: commands take ")


def test_no_forger_silences_a_function_and_a_credulous_pe_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = load_spec("dg_specs/examples/demux_actuators.dg.yaml")
    quiet_ms, ended = denied(spec, 5, 1, None)
    assert (quiet_ms < 60, ended) == (True, 0)
    assert denied(spec, 5, 1, "forged_epoch", 9) <= (quiet_ms + 50, 0)
    monkeypatch.setattr(OutputAuthorization, "neighbour_runs", OutputAuthorization.saw_epoch)
    silent_ms, _ = denied(spec, 5, 1, "forged_epoch", 9)
    assert silent_ms > quiet_ms + 50
