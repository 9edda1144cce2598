"""The epochs that the manager's core deploys, one after the other; the faults on the way, and the core's reaction."""

from dataclasses import replace
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement, FailElement, OperatorSaid, PlanFailed
from heronry_wire.frame import Frame
from heronry_wire.management import ElementKind, Emergency, FaultCode, Lease
from heronry_wire.state_frames import PeState, StatePage0
from manager.one_manager import BEAT_NS, MS, SPEC_TEXT, OneManager

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)
CONTROL_RAISED = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, 0, 0)


@pytest.fixture
def manager() -> OneManager:
    """The elevator is driven from the left, the first epoch is active everywhere."""
    flying = OneManager()
    flying.start()
    assert flying.last(events.Reconfigured).started == ("control", "drive_left")
    return flying


def take_everywhere(manager: OneManager, state: PeState = PeState.ACTIVE) -> None:
    for pe in list(manager.running):
        manager.take(pe, state)


def stage_everywhere(manager: OneManager) -> None:
    for pe in list(manager.running):
        manager.stage(pe)


def test_a_killed_pe_is_planned_around_and_the_four_times_are_reported(manager: OneManager) -> None:
    manager.die("left")
    manager.pass_time(100 * MS)
    assert manager.requests[-1].now.down == {"pe:left"}
    assert manager.requests[-1].running is not None
    manager.answer()
    stage_everywhere(manager)
    manager.pass_time(5 * MS)
    assert manager.steps()[-1] == "GO"
    manager.pass_time(100 * MS)
    assert manager.steps()[-1] == "GO_ALL"
    take_everywhere(manager)
    told = manager.last(events.Reconfigured)
    assert told.causes == ("pe:left: silent for 3 heartbeat periods",)
    assert told.times_ns.detect == 65 * MS
    assert told.started == ("drive_right",)
    assert all(time_ns >= 0 for time_ns in told.times_ns.by_name().values())


def test_the_death_of_a_pe_that_must_break_turns_the_wait_into_the_wait_for_its_lease(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    manager.die("left")
    manager.pass_time(70 * MS)
    assert manager.steps()[-1] == "GO"
    manager.pass_time(100 * MS)
    assert manager.steps()[-1] == "GO_ALL"


def test_a_fault_after_activation_leaves_the_epoch_standing_until_the_next_one(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    standing, _ = manager.prepared()
    manager.report("right", CONTROL_RAISED)
    manager.pass_time(BEAT_NS)
    assert manager.said(Lease)[-1].epoch == standing
    manager.answer()
    assert manager.prepared()[0] == standing + 1
    manager.pass_time(BEAT_NS)
    assert manager.said(Lease)[-1].epoch == standing


def test_causes_that_come_while_an_epoch_is_activated_are_reported_with_the_next_one(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    manager.report("right", CONTROL_RAISED)
    take_everywhere(manager)
    assert manager.last(events.Reconfigured).causes == ("device:servo_left failed, reported by left",)
    manager.answer()
    stage_everywhere(manager)
    take_everywhere(manager, PeState.BROKEN)
    take_everywhere(manager)
    told = manager.last(events.Reconfigured)
    assert told.causes == ("module:control failed, reported by right",)
    assert all(time_ns >= 0 for time_ns in told.times_ns.by_name().values())


def test_a_plan_that_runs_already_is_no_epoch(manager: OneManager) -> None:
    useless = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 1, 0)  # the right servo, which no module drives
    manager.report("right", useless)
    manager.answer()
    assert isinstance(manager.events[-1], events.PlanUnchanged)
    assert len(manager.of(events.EpochPrepared)) == 1


def test_a_pe_that_joins_is_given_an_epoch_even_where_the_plan_stays_the_same(manager: OneManager) -> None:
    manager.reboot("right")
    manager.answer()
    assert isinstance(manager.events[-1], events.PlanUnchanged)
    manager.pass_time(250 * MS)
    assert manager.last(events.PeJoined).pe == "right"
    manager.answer()
    assert manager.last(events.EpochPrepared).pes == ("left", "middle", "right")


def test_a_pe_that_joins_with_the_epoch_of_an_older_mastership_breaks_first() -> None:
    manager = OneManager(term=2)
    manager.live("left", PeState.ACTIVE, epoch=5, digest=5)
    manager.live("middle", PeState.ACTIVE, epoch=5, digest=5)
    manager.live("right")
    manager.pass_time(110 * MS)
    manager.answer()
    stage_everywhere(manager)
    (step,) = manager.of(events.EpochStep)
    assert (step.step, step.waiting_for) == (
        "BREAK",
        ("left", "middle"),
    )  # what they send is not known
    assert manager.of(events.PeLost) == []


def test_a_page_that_comes_late_does_not_change_what_is_known_to_run(manager: OneManager) -> None:
    page = replace(manager.running["middle"], sequence=8)
    stale = replace(page, state=PeState.UNCONFIGURED, epoch=0, digest=0)
    for sequence, lost in ((8, 0), (7, 0), (0, 0), (255, 1)):
        said = page if sequence == 8 else replace(stale, sequence=sequence)
        manager.hear(Frame(manager.state_id("middle"), said.encode()))
        assert len(manager.of(events.PeLost)) == lost


def test_with_no_pe_left_to_command_the_empty_configuration_is_an_epoch_too(manager: OneManager) -> None:
    for pe in ("left", "middle", "right"):
        manager.give(OperatorSaid(1, FailElement(f"pe:{pe}")))
    assert manager.requests[-1].now.down == {"pe:left", "pe:middle", "pe:right"}
    manager.answer()
    assert manager.last(events.Reconfigured).stopped == ("control", "drive_left")


def test_an_epoch_too_old_to_be_remembered_is_one_that_no_manager_commanded(manager: OneManager) -> None:
    first = manager.prepared()
    for servo in ("device:servo_left", "device:servo_right") * 5:
        manager.give(OperatorSaid(1, FailElement(servo)))
        manager.answer()
        stage_everywhere(manager)
        take_everywhere(manager, PeState.BROKEN)
        take_everywhere(manager)
        manager.give(OperatorSaid(2, ClearElement(servo)))
        manager.answer()
    assert manager.prepared() == (first[0] + 10, first[1])
    manager.live("left", PeState.ACTIVE, epoch=first[0], digest=first[1])
    assert "which no manager commanded" in manager.last(events.PeLost).cause


def test_a_pe_that_is_late_for_the_plan_that_runs_and_has_work_in_it_needs_an_epoch(manager: OneManager) -> None:
    epoch = manager.prepared()[0]
    manager.reboot("left")
    manager.pass_time(250 * MS)
    assert manager.requests[-1].now.down == frozenset()
    manager.answer()
    assert manager.of(events.PlanUnchanged) == []
    assert manager.prepared()[0] > epoch


def test_a_pe_that_dies_while_its_slice_is_sent_holds_up_no_other() -> None:
    slow = OneManager(loads(SPEC_TEXT.replace("bitrate: 1000000", "bitrate: 20000"), "slow.dg.yaml"))
    slow.start(fly=False)
    slow.answer()
    assert slow.heads_to("left") == 0
    slow.die("left")
    slow.pass_time(70 * MS)
    slow.answer()
    slow.pass_time(100 * MS)
    assert slow.heads_to("middle") > 0


# Beyond a gateway that is gone


def beyond_a_dead_gateway(name: str, gateway: str) -> OneManager:
    """A manager that has just lost a gateway, and has a plan without it; the PEs beyond beat on for now."""
    manager = OneManager(load(Path(__file__).parent.parent / "scenarios" / f"{name}.dg.yaml"))
    manager.start()
    manager.die(gateway)
    manager.pass_time(70 * MS)
    manager.answer()
    return manager


def test_an_epoch_does_not_wait_for_pes_beyond_a_dead_gateway() -> None:
    manager = beyond_a_dead_gateway("both_sides", "gateway")
    epoch, _ = manager.prepared()
    assert "wing" in manager.last(events.EpochPrepared).pes
    for pe in ("front", "rear"):
        manager.stage(pe)
    assert manager.last(events.EpochStep).epoch == epoch


def test_an_epoch_waits_for_pes_beyond_a_dead_gateway_if_there_are_no_others() -> None:
    manager = beyond_a_dead_gateway("slow_far_bus", "gw")
    epoch, _ = manager.prepared()
    assert manager.last(events.EpochStep).epoch != epoch
    for pe in ("f1", "f2", "f3"):
        manager.stage(pe)
    assert manager.last(events.EpochStep).epoch == epoch


# A PE that returns with a newer epoch than all others run


def overtaken() -> OneManager:
    """`left` was planned around, and is back with what another manager gave it meanwhile; it is still held down."""
    manager = OneManager()
    manager.start()
    manager.die("left")
    manager.pass_time(110 * MS)
    manager.answer()
    stage_everywhere(manager)
    take_everywhere(manager)
    manager.pass_time(100 * MS)
    assert manager.last(events.Reconfigured).stopped == ("drive_left",)
    manager.running["left"] = StatePage0(PeState.ACTIVE, manager.flags, 1, 40, 0, 7)
    manager.pass_time(BEAT_NS)
    return manager


def test_what_runs_gets_a_newer_number_than_the_epoch_that_a_returning_pe_shows() -> None:
    manager = overtaken()
    assert manager.requests[-1].now.down == {"pe:left"}
    assert manager.last(events.PlanRequested).causes == ("pe:left: it runs a newer epoch",)
    requested = len(manager.requests)
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == requested
    manager.answer()
    assert manager.last(events.EpochPrepared).epoch == 41
    assert manager.last(events.EpochPrepared).pes == ("middle", "right")
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == requested


def test_the_plan_is_requested_again_where_the_planner_fails() -> None:
    manager = overtaken()
    requested = len(manager.requests)
    manager.give(PlanFailed(manager.requests[-1].request, "it was killed"))
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == requested
