"""The oracle `availability`, and forgers that deny service: each defect that it is there for is found by it."""

from collections import Counter, deque
from typing import Any

import pytest

from heronry_agent.core.authority import Authenticity, OutputAuthorization
from heronry_agent.core.authority.state_seal import StateSeal
from heronry_manager import events
from heronry_manager.core.authentication import authenticity
from heronry_manager.core.authentication.nonce_answers import NonceAnswers
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.end_of_flight import end_flight
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_wire.authentication import Key, Session

SPEC = load_spec("dg_specs/examples/demux_actuators.dg.yaml")
SECONDS = 2


def denied(kind: str, percent: int = 9, *others: str) -> Counter[str]:
    """Fly under a forger, and with other faults; gives the number of violations by oracle."""
    texts = [f"0.5 {kind} bus:can0 for {SECONDS} level {percent}", *others]
    faults = tuple(read_fault(SPEC, text) for text in texts)
    flight = Simulation(SPEC, 3, key=KEY)
    while not flight.events_of(events.Reconfigured):
        flight.run_for(MS)
    injections = Injections(flight, faults, flight.now_ns)
    flight.run_for(round((SECONDS + 0.5) * 1000) * MS)
    return Counter(one.rule for one in end_flight(flight, injections, [fault.target for fault in faults]))


def believes_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a state of a neighbour hold outputs back, as without a key."""
    monkeypatch.setattr(OutputAuthorization, "neighbour_runs", OutputAuthorization.saw_epoch)


def answers_any_nonce(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the manager answer any nonce, PEs ask whatever they hear, and each answer begin a session."""

    def is_due(self: Any, _nonce: int, now_ns: int) -> bool:
        may = not self._last_ns or now_ns - self._last_ns[-1] >= self._period_ns // 2
        self._last_ns.extend([now_ns] if may else [])
        return may

    def welcomed(self: Any, manager: int, term: int, counter: int) -> None:
        self._sessions[manager], self._first_beat = Session(manager, term, counter), None

    class Forgetful(authenticity._Peer):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            self.offers = deque(maxlen=2)

    monkeypatch.setattr(authenticity, "_Peer", Forgetful)
    monkeypatch.setattr(Key, "is_plausible", lambda _self, _node, _nonce: True)
    monkeypatch.setattr(NonceAnswers, "is_due", is_due)
    monkeypatch.setattr(Authenticity, "_is_led", lambda _: False)
    monkeypatch.setattr(StateSeal, "welcomed", welcomed)


@pytest.mark.parametrize(
    ("kind", "defect"), [("forged_epoch", believes_neighbours), ("forged_session", answers_any_nonce)]
)
def test_forged_frames_below_a_tenth_of_the_bus_deny_nothing_and_each_defect_is_found(
    monkeypatch: pytest.MonkeyPatch, kind: str, defect: Any
) -> None:
    assert denied(kind) == Counter()
    defect(monkeypatch)
    assert denied(kind)["availability"] > 0


def test_a_tenth_of_the_bus_and_a_flight_with_another_fault_are_not_verified(monkeypatch: pytest.MonkeyPatch) -> None:
    believes_neighbours(monkeypatch)
    assert denied("forged_epoch", 10)["availability"] == 0
    assert denied("forged_epoch", 9, "0.5 reboot pe:tail_b")["availability"] == 0
