"""The judges of a simulated run see what they are for, and nothing else."""

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_tools.simulator.bus import Clash, Sent
from heronry_tools.simulator.checks import Checks
from heronry_tools.simulator.nodes import Driven
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    Activate,
    ElementKind,
    Emergency,
    FaultCode,
    PeFlags,
    PeState,
    StatePage0,
    Step,
)

SPEC = load(shipped_spec_path("elevator_and_chute"))
WELL = Situation()
TAIL = 94


def sent(frame: Frame, sender: str = "tail_pe", t_ns: int = 0) -> Sent:
    return Sent(t_ns, "can0", sender, frame)


def activation(epoch: int, step: Step = Step.GO_ALL) -> Sent:
    return sent(Frame(management_id(126, Command.ACTIVATE), Activate(1, epoch, step, 5).encode()), "manager 126")


def state(epoch: int, digest: int, incarnation: int = 1, state: PeState = PeState.ACTIVE, node: int = TAIL) -> Sent:
    return sent(Frame(state_id(node), StatePage0(state, PeFlags(0), incarnation, epoch, 0, digest).encode()))


def rules(checks: Checks, truth: Situation = WELL) -> list[str]:
    return [violation.rule for violation in checks.broken(truth, [])]


def drive(checks: Checks, *modules: str) -> None:
    for t_ns, module in enumerate(modules):
        checks.driven(Driven(t_ns, "tail_pe", module))


def test_a_demux_may_change_hands_with_every_epoch() -> None:
    checks = Checks(SPEC)
    for epoch, module in enumerate(["servo_driver_1", "servo_driver_2", "servo_driver_1"], start=1):
        checks.see(activation(epoch))
        drive(checks, module, module)
    assert rules(checks) == []


def test_a_demux_driven_in_turn_within_an_epoch_has_two_drivers() -> None:
    checks = Checks(SPEC)
    checks.see(activation(1))
    drive(checks, "servo_driver_1", "servo_driver_2", "servo_driver_1")
    checks.see(activation(2, Step.PREPARED))
    assert rules(checks) == ["exclusion"]


def test_an_identifier_sent_in_turn_by_two_nodes_is_seen_and_on_another_bus_it_is_another() -> None:
    checks = Checks(load(shipped_spec_path("big_blue")))
    datum = Frame(1536, bytes(8))
    for sender in ("tail_pe", "sensor_pe"):
        checks.see(Sent(0, "can0", sender, datum))
        checks.see(Sent(0, "radio", "comms", datum))
    assert rules(checks) == []
    checks.see(Sent(0, "can0", "tail_pe", datum))
    assert rules(checks) == ["exclusion"]


def test_one_epoch_has_one_digest() -> None:
    checks = Checks(SPEC)
    checks.see(state(1, 5))
    checks.see(state(1, 5, node=93))
    assert rules(checks) == []
    checks.see(state(1, 6, node=92))
    assert rules(checks) == ["digest"]


def test_an_epoch_goes_back_only_with_a_new_incarnation() -> None:
    checks = Checks(SPEC)
    checks.see(state(3, 5))
    checks.see(state(0, 0, incarnation=2, state=PeState.UNCONFIGURED))
    checks.see(state(2, 7, incarnation=2))
    assert rules(checks) == []
    checks.see(state(1, 8, incarnation=2))
    assert rules(checks) == ["epoch"]


def test_a_report_of_what_has_not_failed_is_a_false_one() -> None:
    checks = Checks(SPEC)
    emergency = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 7)
    checks.see(sent(Frame(emcy_id(TAIL), emergency.encode())))
    checks.see(sent(Frame(emcy_id(TAIL), Emergency(FaultCode.RESET, 0, ElementKind.PE, 0, 0).encode())))
    assert rules(checks, Situation(frozenset({"device:gps"}))) == []
    assert rules(checks) == ["blame"]


def test_a_clash_is_a_violation() -> None:
    (violation,) = Checks(SPEC).broken(WELL, [Clash(5, "can0", 1536, ("a", "b"))])
    assert str(violation) == "0.000000 s  clash: a and b both wanted to send 1536 on can0"


def test_silence_is_not_settled() -> None:
    stories = [violation.story for violation in Checks(SPEC).unsettled(WELL, 1_000_000_000)]
    assert "tail_pe is healthy, and silent" in stories
    assert "class A: elevator could be served, and is not heard" in stories
    nothing_left = Situation(frozenset(f"pe:{pe}" for pe in SPEC.pes))
    assert Checks(SPEC).unsettled(nothing_left, 1_000_000_000) == []


def test_pes_in_different_epochs_or_on_their_way_are_not_settled() -> None:
    checks = Checks(SPEC)
    checks.see(state(1, 5, node=92))
    checks.see(state(2, 6, node=93))
    checks.see(state(2, 6, node=94, state=PeState.BROKEN))
    stories = [violation.story for violation in checks.unsettled(WELL, 1)]
    assert "tail_pe is BROKEN in epoch 2" in stories
    assert "the healthy PEs are in epochs [1, 2]" in stories
