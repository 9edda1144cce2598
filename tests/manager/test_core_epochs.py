"""One epoch after the other, as the manager's core leads them: what goes wrong on the way, and what it does then."""

from dataclasses import replace
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from heronry_manager.core.vocabulary import ClearElement, FailElement, OperatorSaid, PlanFailed, PlanReady
from heronry_wire.frame import Frame
from heronry_wire.management import (
    Activate,
    Alive,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    SliceBody,
    Step,
)
from heronry_wire.protocol_times import PATIENCE_PERIODS, PLAN_AGAIN_NS
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from manager.one_manager import BEAT_NS, MS, SPEC_TEXT, OneManager

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)
CONTROL_RAISED = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, 0, 0)


@pytest.fixture
def manager() -> OneManager:
    """The elevator is driven from the left, the first epoch is active everywhere."""
    flying = OneManager()
    flying.start()
    assert flying.last("reconfigured")["started"] == ["control", "drive_left"]
    return flying


def take_everywhere(manager: OneManager, state: PeState = PeState.ACTIVE) -> None:
    for pe in list(manager.running):
        manager.take(pe, state)


def stage_everywhere(manager: OneManager) -> None:
    for pe in list(manager.running):
        manager.stage(pe)


def test_the_first_epoch_goes_all_the_way_in_one_step(manager: OneManager) -> None:
    assert manager.steps() == ["GO_ALL"]
    lease = manager.said(Lease)[-1]
    manager.pass_time(BEAT_NS)
    assert manager.said(Lease)[-1].step is Step.GO_ALL
    assert manager.said(Lease)[-1].epoch == manager.prepared()[0]
    assert lease.epoch == 0


def test_a_killed_pe_is_planned_around_and_the_four_times_are_told(manager: OneManager) -> None:
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
    told = manager.last("reconfigured")
    assert told["causes"] == ["pe:left: silent for 3 heartbeat periods"]
    assert told["times_ns"]["detect"] == 65 * MS
    assert told["started"] == ["drive_right"]
    assert all(time_ns >= 0 for time_ns in told["times_ns"].values())


def test_a_demux_waits_until_its_silent_driver_has_not_been_named_for_t_lease(manager: OneManager) -> None:
    manager.die("left")
    manager.pass_time(200 * MS)
    named_ns = max(
        told["t_ns"] for told in manager.of("pe_lost")
    )  # until then every ALIVE named it, the last one at most a period before
    assert 92 not in manager.said(Alive)[-1].nodes
    manager.now_ns = named_ns + 10 * MS
    manager.answer()
    stage_everywhere(manager)
    held_from_ns = manager.now_ns
    manager.pass_time(200 * MS)
    (go, go_all) = manager.of("epoch_step")[-2:]
    assert (go["step"], go_all["step"]) == ("GO", "GO_ALL")
    assert go["t_ns"] == held_from_ns
    assert 80 * MS <= go_all["t_ns"] - named_ns <= 100 * MS


def test_a_demux_waits_no_longer_once_its_driver_is_back_as_a_new_incarnation(manager: OneManager) -> None:
    manager.reboot("left")
    manager.answer()
    assert manager.requests[-1].now.down == {"pe:left"}
    manager.stage("middle")
    manager.stage("right")
    assert manager.steps()[-1] == "GO_ALL"


def test_what_moves_between_healthy_pes_is_broken_before_it_is_made(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    assert manager.last("epoch_step")["waiting_for"] == ["left"]
    assert manager.said(Activate)[-1].step is Step.BREAK
    manager.take("right", PeState.BROKEN)
    assert manager.steps()[-1] == "BREAK"
    manager.take("left", PeState.BROKEN)
    assert manager.steps()[-1] == "GO_ALL"
    take_everywhere(manager)
    assert manager.last("reconfigured")["stopped"] == ["drive_left"]


def test_the_death_of_who_must_break_turns_the_wait_into_the_wait_for_its_lease(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    manager.die("left")
    manager.pass_time(70 * MS)
    assert manager.steps()[-1] == "GO"
    manager.pass_time(100 * MS)
    assert manager.steps()[-1] == "GO_ALL"


def test_a_reported_fault_is_acknowledged_each_time_and_latched_once(manager: OneManager) -> None:
    manager.report("middle", CONTROL_RAISED)
    manager.report("middle", CONTROL_RAISED)
    acknowledged = manager.answers()
    assert [(c.node, c.operation, c.a, c.b) for c in acknowledged] == [(93, Operation.ACKNOWLEDGE, 2, 0)] * 2
    assert [told["element"] for told in manager.of("fault_reported")] == ["module:control"]
    assert manager.requests[-1].now.down == {"module:control"}
    assert len(manager.requests) == 2


@pytest.mark.parametrize(
    "emergency",
    [
        Emergency(FaultCode.RESET, 0, ElementKind.DEVICE, 0, 0),
        Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 99, 0),
    ],
)
def test_a_reset_and_an_element_that_does_not_exist_are_no_faults(manager: OneManager, emergency: Emergency) -> None:
    manager.report("left", emergency)
    assert manager.answers() == []
    assert manager.of("fault_reported") == []


def test_a_fault_while_an_epoch_is_prepared_abandons_its_number(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    abandoned, _ = manager.prepared()
    manager.report("right", CONTROL_RAISED)
    assert manager.last("epoch_abandoned")["epoch"] == abandoned
    manager.answer()
    assert manager.prepared()[0] == abandoned + 1
    assert manager.said(Lease)[-1].epoch == 0 or manager.said(Lease)[-1].epoch < abandoned


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


def test_causes_that_come_while_an_epoch_is_activated_are_told_with_the_next_one(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    stage_everywhere(manager)
    manager.report("right", CONTROL_RAISED)
    take_everywhere(manager)
    assert manager.last("reconfigured")["causes"] == ["device:servo_left failed, reported by left"]
    manager.answer()
    stage_everywhere(manager)
    take_everywhere(manager, PeState.BROKEN)
    take_everywhere(manager)
    told = manager.last("reconfigured")
    assert told["causes"] == ["module:control failed, reported by right"]
    assert all(time_ns >= 0 for time_ns in told["times_ns"].values())


def test_the_answer_to_an_older_question_is_dropped(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    late = manager.requests[-1]
    manager.report("right", CONTROL_RAISED)
    plan = manager.answer()
    prepared = len(manager.of("epoch_prepared"))
    manager.give(PlanReady(late.request, plan))
    manager.give(PlanReady(manager.requests[-1].request, plan))  # and the same answer twice changes nothing
    manager.give(PlanFailed(late.request, "too late"))
    assert len(manager.of("epoch_prepared")) == prepared
    assert manager.of("plan_failed") == []


def test_a_planner_that_fails_is_asked_again_a_second_later(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.give(PlanFailed(manager.requests[-1].request, "it was killed"))
    assert manager.last("plan_failed")["reason"] == "it was killed"
    asked = len(manager.requests)
    manager.pass_time(PLAN_AGAIN_NS - MS)
    assert len(manager.requests) == asked
    manager.pass_time(2 * MS)
    assert len(manager.requests) == asked + 1
    manager.answer()
    assert manager.of("epoch_prepared")


def test_a_plan_that_runs_already_is_no_epoch(manager: OneManager) -> None:
    useless = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 1, 0)  # the right servo, which nobody drives
    manager.report("right", useless)
    manager.answer()
    assert manager.events[-1]["event"] == "plan_unchanged"
    assert len(manager.of("epoch_prepared")) == 1


def test_a_pe_that_joins_is_given_an_epoch_even_where_the_plan_stays_the_same(manager: OneManager) -> None:
    manager.reboot("right")
    manager.answer()
    assert manager.events[-1]["event"] == "plan_unchanged"
    manager.pass_time(250 * MS)
    assert manager.last("pe_joined")["pe"] == "right"
    manager.answer()
    assert manager.last("epoch_prepared")["pes"] == ["left", "middle", "right"]


def test_who_runs_nothing_although_it_was_configured_has_lost_its_configuration(manager: OneManager) -> None:
    manager.live("left", PeState.UNCONFIGURED)
    lost = manager.last("pe_lost")
    assert (lost["pe"], lost["cause"]) == ("left", "it runs nothing although it was configured")
    manager.answer()
    manager.stage("middle")
    manager.stage("right")
    assert manager.steps()[-1] == "GO_ALL"  # what runs nothing holds nothing


@pytest.mark.parametrize(("epoch", "digest"), [(1, 0xBAD), (77, 5)])
def test_who_runs_what_nobody_commanded_is_lost(manager: OneManager, epoch: int, digest: int) -> None:
    manager.live("middle", PeState.ACTIVE, epoch=epoch, digest=digest)
    assert "which nobody commanded" in manager.last("pe_lost")["cause"]


def test_the_identifiers_of_a_pe_that_was_given_up_but_speaks_wait_for_its_lease(manager: OneManager) -> None:
    manager.live("left", PeState.ACTIVE, epoch=1, digest=0xBAD)
    given_up_ns = manager.now_ns
    assert manager.answer().configuration.modules["control"].pe == "middle"
    for pe in ("middle", "right"):
        manager.stage(pe)
    for pe in ("middle", "right"):
        manager.take(pe, PeState.BROKEN)
    assert manager.steps()[-1] == "BREAK"
    manager.pass_time(101 * MS)
    assert manager.steps()[-1] == "GO_ALL"
    assert 100 * MS <= manager.last("epoch_step")["t_ns"] - given_up_ns <= 101 * MS


def test_who_joins_with_the_epoch_of_an_older_reign_breaks_first() -> None:
    manager = OneManager(term=2)
    manager.live("left", PeState.ACTIVE, epoch=5, digest=5)
    manager.live("middle", PeState.ACTIVE, epoch=5, digest=5)
    manager.live("right")
    manager.pass_time(110 * MS)
    manager.answer()
    stage_everywhere(manager)
    (step,) = manager.of("epoch_step")
    assert (step["step"], step["waiting_for"]) == ("BREAK", ["left", "middle"])  # nobody knows what they send
    assert manager.of("pe_lost") == []


def test_a_page_that_comes_late_tells_nothing_of_what_runs(manager: OneManager) -> None:
    page = replace(manager.running["middle"], sequence=8)
    stale = replace(page, state=PeState.UNCONFIGURED, epoch=0, digest=0)
    for sequence, lost in ((8, 0), (7, 0), (0, 0), (255, 1)):
        said = page if sequence == 8 else replace(stale, sequence=sequence)
        manager.hear(Frame(manager.state_id("middle"), said.encode()))
        assert len(manager.of("pe_lost")) == lost


def test_who_refuses_its_slice_is_planned_around(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.stage("right", Reason.IMAGE)
    assert manager.last("pe_refused")["reason"] == "IMAGE"
    assert manager.last("pe_lost")["cause"] == "it cannot stage its slice: IMAGE"
    assert manager.last("epoch_abandoned")


def test_who_has_staged_and_refuses_a_deposed_manager_is_not_blamed(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    epoch, digest = manager.prepared()
    page = StatePage1(PeState.ACTIVE, PeFlags(0), epoch, digest, Reason.STALE_TERM, 0)
    for pe in manager.spec.pes:
        manager.hear(Frame(manager.state_id(pe), page.encode()))
    assert manager.of("pe_refused") == []
    assert manager.last("epoch_step")["epoch"] == epoch


def test_who_has_moved_on_already_is_not_blamed(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.stage("right", Reason.STALE_EPOCH)
    assert manager.of("pe_refused") == []


def test_who_does_not_acknowledge_for_long_is_failed_and_planned_around(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.stage("left")
    manager.stage("middle")
    manager.pass_time(PATIENCE_PERIODS * BEAT_NS - MS)
    assert manager.of("pe_lost") == []
    manager.pass_time(5 * BEAT_NS)
    assert manager.last("pe_lost")["cause"] == "it does not acknowledge"
    assert manager.requests[-1].now.down == {"device:servo_left", "pe:right"}


def test_a_lost_answer_costs_a_repetition(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.pass_time(15 * MS)
    asked = manager.heads_to("right")
    manager.pass_time(15 * MS)
    assert manager.heads_to("right") == asked + 1
    stage_everywhere(manager)
    activations = len(manager.said(Activate))
    manager.pass_time(25 * MS)
    assert len(manager.said(Activate)) == activations + 1


def test_only_bodies_that_changed_go_out_unasked_and_any_goes_out_when_it_is_asked_for(manager: OneManager) -> None:
    manager.commands.clear()
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.pass_time(5 * MS)
    nodes = {body.node for body in manager.said(SliceBody)}
    assert nodes == {92, 94}  # control has a new consumer, and the right a job
    manager.commands.clear()
    manager.stage("right", Reason.INCOMPLETE)
    manager.pass_time(5 * MS)
    assert {body.node for body in manager.said(SliceBody)} == {94}


def test_what_is_not_on_board_is_no_refusal(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    manager.answer()
    manager.stage("right", Reason.NOT_ON_BOARD)
    assert not manager.of("pe_lost")
    assert not manager.of("pe_refused")


def test_with_nobody_left_who_can_be_commanded_the_empty_configuration_is_an_epoch_too(manager: OneManager) -> None:
    for pe in ("left", "middle", "right"):
        manager.give(OperatorSaid(1, FailElement(f"pe:{pe}")))
    assert manager.requests[-1].now.down == {"pe:left", "pe:middle", "pe:right"}
    manager.answer()
    assert manager.last("reconfigured")["stopped"] == ["control", "drive_left"]


def test_an_epoch_too_old_to_be_remembered_is_one_that_nobody_commanded(manager: OneManager) -> None:
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
    assert "which nobody commanded" in manager.last("pe_lost")["cause"]


def test_who_comes_back_with_nothing_to_do_is_admitted_to_the_epoch_that_runs(manager: OneManager) -> None:
    manager.die("middle")
    manager.pass_time(100 * MS)
    manager.answer()
    for pe in ("left", "right"):
        manager.stage(pe)
    for pe in ("left", "right"):
        manager.take(pe, PeState.ACTIVE)
    epoch, digest = manager.prepared()
    assert manager.last("reconfigured")["epoch"] == epoch
    manager.commands.clear()
    manager.live("middle")
    manager.pass_time(300 * MS)
    manager.answer()
    assert manager.prepared() == (epoch, digest)
    assert manager.of("plan_unchanged")
    assert manager.heads_to("middle") == 1
    manager.pass_time(25 * MS)
    assert manager.heads_to("middle") == 2
    manager.stage("middle")
    manager.pass_time(5 * MS)
    manager.take("middle", PeState.ACTIVE)
    assert manager.core.status()["pes"]["middle"]["epoch"] == epoch
    manager.report("middle", LEFT_SERVO_FAILED)
    manager.answer()
    assert manager.prepared()[0] != epoch


def test_a_module_that_began_again_is_told_and_acknowledged_and_nothing_is_planned(manager: OneManager) -> None:
    requests = len(manager.requests)
    manager.report("middle", Emergency(FaultCode.MODULE_RESTARTED, 0, ElementKind.MODULE, 0, 2))
    assert [(c.node, c.operation) for c in manager.answers()] == [(93, Operation.ACKNOWLEDGE)]
    assert (manager.last("module_restarted")["element"], manager.last("module_restarted")["times"]) == (
        "module:control",
        2,
    )
    assert len(manager.requests) == requests


def test_a_count_of_restarts_is_told_once_however_often_it_is_repeated(manager: OneManager) -> None:
    def again(times: int, module: int = 0) -> list[tuple[str, int]]:
        manager.report("middle", Emergency(FaultCode.MODULE_RESTARTED, 0, ElementKind.MODULE, module, times))
        return [(event["element"], event["times"]) for event in manager.of("module_restarted")]

    told = [("module:control", 1)]
    assert again(1) == told
    for _ in range(2):
        manager.pass_time(100 * MS)  # T_lease
        assert again(1) == told
    assert len(manager.answers()) == 3  # each is acknowledged: the one before may have been lost
    assert again(1, module=1) == (told := [*told, ("module:drive_left", 1)])
    assert again(2) == (told := [*told, ("module:control", 2)])
    manager.pass_time(101 * MS)
    assert again(2) == [*told, ("module:control", 2)]


def test_a_suspect_that_answers_in_time_is_told(manager: OneManager) -> None:
    page = manager.running.pop("middle")
    manager.pass_time(26 * MS)
    manager.running["middle"] = page
    manager.beat("middle")
    assert [manager.last(kind)["pe"] for kind in ("pe_suspected", "pe_answered")] == ["middle", "middle"]
    assert manager.of("pe_lost") == []


def test_who_is_late_for_the_plan_that_runs_and_has_work_in_it_needs_an_epoch(manager: OneManager) -> None:
    epoch = manager.prepared()[0]
    manager.reboot("left")
    manager.pass_time(250 * MS)
    assert manager.requests[-1].now.down == frozenset()
    manager.answer()
    assert manager.of("plan_unchanged") == []
    assert manager.prepared()[0] > epoch


def test_a_pe_that_dies_while_its_slice_is_sent_holds_nobody_up() -> None:
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
    """A manager that has just lost a gateway, and has a plan without it; who is beyond beats on for now."""
    manager = OneManager(load(Path(__file__).parent.parent / "scenarios" / f"{name}.dg.yaml"))
    manager.start()
    manager.die(gateway)
    manager.pass_time(70 * MS)
    manager.answer()
    return manager


def test_nobody_waits_for_who_is_beyond_a_dead_gateway() -> None:
    manager = beyond_a_dead_gateway("both_sides", "gateway")
    epoch, _ = manager.prepared()
    assert "wing" in manager.last("epoch_prepared")["pes"]
    for pe in ("front", "rear"):
        manager.stage(pe)
    assert manager.last("epoch_step")["epoch"] == epoch


def test_unless_there_is_nobody_else_to_command() -> None:
    manager = beyond_a_dead_gateway("slow_far_bus", "gw")
    epoch, _ = manager.prepared()
    assert manager.last("epoch_step")["epoch"] != epoch
    for pe in ("f1", "f2", "f3"):
        manager.stage(pe)
    assert manager.last("epoch_step")["epoch"] == epoch


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
    assert manager.last("reconfigured")["stopped"] == ["drive_left"]
    manager.running["left"] = StatePage0(PeState.ACTIVE, manager.flags, 1, 40, 0, 7)
    manager.pass_time(BEAT_NS)
    return manager


def test_what_runs_gets_a_newer_number_than_the_epoch_that_a_returning_pe_shows() -> None:
    manager = overtaken()
    assert manager.requests[-1].now.down == {"pe:left"}
    assert manager.last("plan_requested")["causes"] == ["pe:left: it runs a newer epoch"]
    asked = len(manager.requests)
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == asked
    manager.answer()
    assert manager.last("epoch_prepared")["epoch"] == 41
    assert manager.last("epoch_prepared")["pes"] == ["middle", "right"]
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == asked


def test_it_is_asked_for_again_like_any_other_plan_where_the_planner_fails() -> None:
    manager = overtaken()
    asked = len(manager.requests)
    manager.give(PlanFailed(manager.requests[-1].request, "it was killed"))
    manager.pass_time(2 * BEAT_NS)
    assert len(manager.requests) == asked
