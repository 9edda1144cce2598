"""An element is retired while it works: the best plan is made in time, and only then does anything move."""

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.core.intake.retirement import connected_by, parts_of
from heronry_manager.core.vocabulary import FailElement, PlanFailed, RestoreElement, RetireElement
from heronry_wire.management import Alive, Control, ElementKind, Emergency, FaultCode, Operation
from heronry_wire.state_frames import PeState
from manager.one_manager import BEAT_NS, MS, TERM, OneManager, two_tails
from manager.test_operator import say

FAILED_CONTROL = Emergency(
    FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, list(two_tails().modules).index("control"), 0
)
LEFT_PARTS = {"module:control@left", "module:drive_left"}


@pytest.fixture
def manager() -> OneManager:
    flying = OneManager()
    flying.start()
    return flying


def fly_the_plan(manager: OneManager, *pes: str) -> None:
    """Answer the request for a plan, and let the PEs stage and run it."""
    manager.answer()
    for pe in pes:
        manager.stage(pe)
    for state in (PeState.BROKEN, PeState.ACTIVE):
        for pe in pes:
            manager.take(pe, state)
        manager.pass_time(2 * BEAT_NS)


def test_a_retired_pe_runs_on_until_the_best_plan_has_come_and_stays_available(manager: OneManager) -> None:
    reply = say(manager, RetireElement("pe:left"))
    assert reply.done
    assert "switch it off when" in reply.sentence
    request = manager.requests[-1]
    assert request.in_background  # the planner takes its time
    assert request.now.down == LEFT_PARTS
    manager.pass_time(10 * BEAT_NS)
    assert manager.requests[-1] is request
    assert not manager.core.is_pressed  # so the shell does not stop the planner that is to answer
    fly_the_plan(manager, *manager.spec.pes)
    told = manager.last(events.Reconfigured)
    assert told.causes == ("pe:left retired by the operator",)
    assert set(told.stopped) | set(told.moved) >= {"drive_left"}
    assert not manager.of(events.PeLost)
    assert len({frozenset(one.nodes) for one in manager.said(Alive)}) == 1  # it counts on all three, all the time
    assert "already" in say(manager, RetireElement("pe:left")).sentence


def test_a_plan_that_serves_less_is_deployed_too(manager: OneManager) -> None:
    say(manager, RetireElement("pe:left"))
    fly_the_plan(manager, *manager.spec.pes)
    assert say(manager, RetireElement("device:servo_right")).done
    assert manager.answer().objective.critical[0] == 0
    assert manager.last(events.PlanReady)
    assert not manager.of(events.PlanKept)


def test_a_fault_meanwhile_does_not_wait_for_the_best_plan(manager: OneManager) -> None:
    say(manager, RetireElement("pe:left"))
    say(manager, FailElement("module:control@middle"))
    assert not manager.requests[-1].in_background
    assert manager.requests[-1].now.down == LEFT_PARTS | {"module:control@middle"}


def test_a_planner_that_fails_is_asked_again_for_any_plan(manager: OneManager) -> None:
    say(manager, RetireElement("pe:left"))
    manager.give(PlanFailed(manager.requests[-1].request, "it was killed"))
    manager.pass_time(2_000 * MS)
    assert not manager.requests[-1].in_background


def test_a_restored_pe_is_used_again(manager: OneManager) -> None:
    assert not say(manager, RestoreElement("pe:left")).done
    say(manager, RetireElement("pe:left"))
    fly_the_plan(manager, *manager.spec.pes)
    reply = say(manager, RestoreElement("pe:left"))
    assert reply.done
    assert manager.requests[-1].now.down == set()
    assert [one.operation for one in manager.answers()] == [Operation.CLEAR] * len(LEFT_PARTS)


def test_a_restored_pe_keeps_the_faults_that_were_reported(manager: OneManager) -> None:
    manager.report("left", FAILED_CONTROL)
    manager.answer()
    manager.pass_time(10 * MS)
    assert not say(manager, RestoreElement("pe:left")).done
    say(manager, RetireElement("module:control"))
    reply = say(manager, RestoreElement("module:control"))
    assert manager.core.now.down == {"module:control@left"}, reply.sentence


def test_what_only_the_manager_before_knew_is_named_and_not_restored(manager: OneManager) -> None:
    told = Control(TERM + 1, 0, Operation.HOLDS, ElementKind.DEVICE, 0)
    manager.core._known.situation.overheard(127, told)  # as a standby manager hears it
    (device,) = manager.core.now.down
    reply = say(manager, RestoreElement(device))
    assert not reply.done
    assert f"{device}; end each with 'heronry clear'" in reply.sentence
    assert manager.core.now.down == {device}


def test_an_order_during_a_reconfiguration_and_one_that_would_stop_everything_are_refused(manager: OneManager) -> None:
    reply = say(manager, RetireElement("bus:can0"))
    assert not reply.done
    assert "would stop everything" in reply.sentence
    say(manager, FailElement("module:control@middle"))
    reply = say(manager, RetireElement("pe:left"))
    assert not reply.done
    assert "a reconfiguration is under way" in reply.sentence
    assert not manager.core.now.down & LEFT_PARTS


def test_before_anything_runs_a_plan_is_requested_at_once() -> None:
    manager = OneManager()
    manager.start(fly=False)
    reply = say(manager, RetireElement("pe:left"))
    assert not reply.done  # the first plan is under way


def test_the_parts_of_an_element_and_what_only_a_gateway_connects() -> None:
    spec = two_tails()
    assert parts_of(spec, "device:servo_left") == ("device:servo_left",)
    assert set(parts_of(spec, "pe:left")) == LEFT_PARTS
    assert connected_by(spec, "pe:left") == ()
    big_blue = load(shipped_spec_path("big_blue"))
    gateways = [pe.name for pe in big_blue.pes.values() if len(pe.buses) > 1]
    assert any(connected_by(big_blue, f"pe:{pe}") for pe in gateways)


def test_a_gateway_is_retired_after_the_pes_behind_it() -> None:
    spec = load(shipped_spec_path("big_blue"))
    gateway = next(pe for pe in spec.pes if connected_by(spec, f"pe:{pe}"))
    manager = OneManager(spec)
    for pe in spec.pes:
        manager.live(pe)
    manager.pass_time(110 * MS)
    reply = say(manager, RetireElement(f"pe:{gateway}"))
    assert not reply.done
    assert "retire these first" in reply.sentence
