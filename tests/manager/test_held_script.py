"""A script of the operator: its target is compared with the best plan, deployed, and held until something ends it."""

from dataclasses import replace

import pytest

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.vocabulary import (
    ClearElement,
    FailElement,
    FlyTarget,
    OperatorSaid,
    PlanFailed,
    PlanReady,
    ReleaseTarget,
    Reply,
    Settled,
)
from heronry_manager.planner.exact import plan
from heronry_wire.management import Control, ElementKind, Lease, Operation, Step
from heronry_wire.state_frames import PeFlags, PeState
from lab.peers import command_frame
from manager.one_manager import BEAT_NS, MS, OneManager
from manager.test_standby import Pair


def target(drive: str = "drive_right", on: str = "right", control: str = "middle") -> Configuration:
    """What a script leads to: control on this PE, and the other branch of the elevator."""
    demand = {"": Wire("control", "demand", 1)}
    return Configuration({"control": Running(control, "only", {}), drive: Running(on, "only", demand)})


def say(manager: OneManager, order: FlyTarget | ReleaseTarget | FailElement | ClearElement) -> Reply:
    actions = manager.give(OperatorSaid(1, order))
    return next(action for action in actions if isinstance(action, Reply))


def script(manager: OneManager) -> tuple[str, str | None]:
    said = manager.core.status()["script"]
    return said["state"], said["why"]


def finish(manager: OneManager) -> None:
    """Let every available PE stage and run what is prepared."""
    for pe in manager.running:
        manager.stage(pe)
    for pe in manager.running:
        manager.take(pe, PeState.ACTIVE)


@pytest.fixture
def manager() -> OneManager:
    one = OneManager()
    one.start()
    assert one.core.plan is not None
    assert "drive_left" in one.core.plan.configuration.modules
    return one


@pytest.fixture
def held(manager: OneManager) -> OneManager:
    assert say(manager, FlyTarget(target())).done
    manager.answer()
    finish(manager)
    return manager


def test_a_target_is_compared_with_the_best_plan_and_deployed(manager: OneManager) -> None:
    reply = say(manager, FlyTarget(target()))
    assert (reply.done, script(manager)) == (True, ("asked", None))
    assert "the script flies unless the best plan, now being made, is better at level 1" in reply.sentence
    request = manager.requests[-1]
    assert (request.in_background, request.target) == (True, target())
    manager.answer()
    assert manager.last(events.ScriptTaken).reason == "it is legal, and serves as much at level 1 as the best plan"
    finish(manager)
    told = manager.last(events.Reconfigured)
    assert told.causes == ("a script of the operator",)
    assert (told.started, told.stopped) == (("drive_right",), ("drive_left",))
    assert script(manager) == ("held", None)
    assert manager.core.plan is not None
    assert manager.core.plan.configuration == target()


def test_nothing_better_is_sought_while_it_is_held(held: OneManager) -> None:
    before = len(held.requests)
    held.pass_time(1000 * MS)
    assert len(held.requests) == before
    assert held.core.plan is not None
    assert not held.core.plan.optimal


def test_released_it_ends_and_the_best_plan_is_sought(held: OneManager) -> None:
    reply = say(held, ReleaseTarget())
    assert (reply.done, script(held)) == (True, ("ended", "the operator released it"))
    assert held.requests[-1].in_background
    assert held.requests[-1].target is None
    held.answer()
    assert isinstance(held.events[-1], events.PlanKept)  # as good at levels 1 to 3: nothing moves back
    again = say(held, ReleaseTarget())
    assert (again.done, again.sentence) == (False, "no script is held: see 'heronry status'")


def test_released_while_it_is_deployed_it_goes_on_and_a_better_plan_is_sought_afterwards(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    manager.answer()
    assert say(manager, ReleaseTarget()).done
    assert manager.requests[-1].target == target()  # nothing new is requested yet
    finish(manager)
    assert manager.requests[-1].target is None
    assert manager.requests[-1].in_background


def test_what_is_asked_for_can_be_released(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    assert say(manager, ReleaseTarget()).done
    assert script(manager) == ("refused", "the operator released it")
    manager.answer()
    assert manager.of(events.ScriptTaken) == []
    assert isinstance(manager.events[-1], events.PlanKept)


def test_a_target_that_is_not_legal_is_refused_at_once(manager: OneManager) -> None:
    before = len(manager.requests)
    reply = say(manager, FlyTarget(target(control="right")))
    assert not reply.done
    assert reply.sentence.startswith("the script is refused, and nothing has changed: ")
    assert manager.last(events.ScriptRefused).reason in reply.sentence
    assert script(manager)[0] == "refused"
    assert len(manager.requests) == before


def test_a_script_with_an_error_is_refused(manager: OneManager) -> None:
    reply = say(manager, FlyTarget(None, "line 3: PCS201: no such component"))
    assert not reply.done
    assert manager.last(events.ScriptRefused).reason == "line 3: PCS201: no such component"


def test_a_target_worse_at_level_1_is_refused_and_nothing_changes(manager: OneManager) -> None:
    assert say(manager, FlyTarget(Configuration())).done
    manager.answer()
    assert script(manager) == ("refused", "it is worse at level 1 than the plan for this situation")
    assert isinstance(manager.events[-1], events.PlanKept)
    assert len(manager.of(events.EpochPrepared)) == 1


def test_a_better_plan_found_on_the_way_flies_as_any_better_plan(manager: OneManager) -> None:
    say(manager, FlyTarget(Configuration()))
    request = manager.requests[-1]
    found = plan(manager.spec, request.now, request.running)
    better = replace(found, objective=replace(found.objective, utility=found.objective.utility + 1))
    other = replace(better, configuration=target())
    manager.give(PlanReady(request.request, other))
    finish(manager)
    assert manager.last(events.Reconfigured).causes == ("a better plan",)
    assert script(manager)[0] == "refused"


def test_without_a_plan_to_compare_it_with_it_is_refused(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    actions = manager.give(PlanFailed(manager.requests[-1].request, "no memory"))
    why = "the planner gave no plan with which to compare the result of the script: no memory"
    assert script(manager) == ("refused", why)
    assert [type(action) for action in actions if isinstance(action, Settled)] == [Settled]


def test_one_script_waits_at_a_time_and_none_while_anything_is_under_way(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    second = say(manager, FlyTarget(target(control="left")))
    assert "a script waits for the best plan: give the order again" in second.sentence
    assert script(manager) == ("asked", None)
    manager.answer()
    third = say(manager, FlyTarget(target(control="left")))
    assert "a reconfiguration is under way" in third.sentence


def test_another_script_takes_the_place_of_the_one_that_is_held(held: OneManager) -> None:
    assert say(held, FlyTarget(target(control="left"))).done
    held.answer()
    assert held.last(events.ScriptEnded).reason == "another script takes its place"
    finish(held)
    assert script(held) == ("held", None)
    assert held.core.plan is not None
    assert held.core.plan.configuration == target(control="left")


def test_a_bad_script_leaves_the_one_that_is_held(held: OneManager) -> None:
    assert say(held, FlyTarget(Configuration())).done
    held.answer()
    assert held.last(events.ScriptRefused).reason.startswith("it is worse")
    assert isinstance(held.events[-1], events.PlanUnchanged)
    assert script(held) == ("held", None)


def test_a_fault_that_makes_it_illegal_ends_it(held: OneManager) -> None:
    say(held, FailElement("device:servo_right"))
    state, why = script(held)
    assert (state, why is not None and "it is no longer legal: " in why) == ("ended", True)
    assert held.requests[-1].target is None
    held.answer()
    finish(held)
    assert held.core.plan is not None
    assert "drive_left" in held.core.plan.configuration.modules


def test_a_fault_that_leaves_it_legal_does_not_end_it(held: OneManager) -> None:
    say(held, FailElement("device:servo_left"))
    assert held.requests[-1].target == target()
    held.answer()
    assert isinstance(held.events[-1], events.PlanUnchanged)
    assert script(held) == ("held", None)


def test_a_situation_in_which_more_is_possible_ends_it() -> None:
    """Nothing at all is legal, and as good as anything while both servos have failed; then one is back."""
    manager = OneManager()
    manager.start()
    for servo in ("servo_left", "servo_right"):
        say(manager, FailElement(f"device:{servo}"))
    manager.answer()
    finish(manager)
    say(manager, FlyTarget(Configuration()))
    manager.answer()
    assert script(manager) == ("held", None)
    say(manager, ClearElement("device:servo_left"))
    assert manager.requests[-1].target == Configuration()
    manager.answer()
    assert manager.last(events.ScriptEnded).reason == "it is worse at level 1 than the plan for this situation"
    finish(manager)
    assert manager.core.plan is not None
    assert "drive_left" in manager.core.plan.configuration.modules


def test_a_fault_before_the_best_plan_comes_refuses_what_is_asked_for(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    say(manager, FailElement("device:servo_left"))
    state, why = script(manager)
    assert state == "refused"
    assert why == "the situation has changed: device:servo_left failed, reported by the operator"
    assert manager.requests[-1].target is None


def test_a_kill_while_it_is_prepared_ends_as_any_fault_does(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    manager.answer()
    manager.die("middle")
    manager.pass_time(100 * MS)
    assert manager.of(events.EpochAbandoned)
    assert script(manager)[0] == "ended"
    manager.answer()
    finish(manager)
    assert manager.core.plan is not None
    assert manager.core.plan.configuration.modules["control"].pe == "left"


def test_the_target_is_prepared_again_where_it_stays_legal(manager: OneManager) -> None:
    say(manager, FlyTarget(target()))
    manager.answer()
    manager.die("left")
    manager.pass_time(100 * MS)
    assert manager.requests[-1].target == target()
    manager.answer()
    finish(manager)
    assert manager.core.plan is not None
    assert (manager.core.plan.configuration, script(manager)) == (target(), ("held", None))


def test_a_standby_manager_is_told_in_turn(held: OneManager) -> None:
    held.commands.clear()
    held.pass_time(1000 * MS)
    told = [one for one in held.said(Control) if one.operation is Operation.HOLDS]
    assert {(one.a, one.b) for one in told} == {(ElementKind.SCRIPT, 0)}
    say(held, ReleaseTarget())
    held.commands.clear()
    held.pass_time(1000 * MS)
    assert held.said(Control) == []


def test_a_standby_manager_that_takes_over_ends_it_and_says_so() -> None:
    pair = Pair()
    for pe in pair.standby.spec.pes:
        pair.say(pe, PeFlags.HEARS_LEASE)
    assert say(pair.primary, FlyTarget(target())).done
    pair.primary.answer()
    finish(pair.primary)
    pair.fly(40 * BEAT_NS)
    pair.orphan("left", "middle", "right")
    assert pair.standby.of(events.TakenOver)
    reason = "the mastership of manager 126, which held it, has ended"
    assert [told.reason for told in pair.standby.of(events.ScriptEnded)] == [reason]
    assert script(pair.standby) == ("ended", reason)


@pytest.mark.parametrize("is_released", [True, False])
def test_a_standby_manager_forgets_a_script_that_it_hears_of_no_more(is_released: bool) -> None:
    """The script was released, or it was that of an earlier mastership."""
    pair = Pair()
    for pe in pair.standby.spec.pes:
        pair.say(pe, PeFlags.HEARS_LEASE)
    holds = Control(pair.primary.core.term, 0, Operation.HOLDS, ElementKind.SCRIPT, 0)
    pair.standby.hear(command_frame(holds))
    if is_released:
        pair.fly(200 * BEAT_NS)
    else:
        pair.standby.hear(command_frame(Lease(pair.primary.core.term + 2, 1, Step.GO_ALL, 0)))
    pair.orphan("left", "middle", "right")
    pair.standby.pass_time(200 * MS)
    assert pair.standby.of(events.TakenOver)
    assert pair.standby.of(events.ScriptEnded) == []


def test_the_end_of_the_mastership_ends_it(held: OneManager) -> None:
    held.running.clear()
    held.pass_time(2000 * MS)
    assert held.of(events.HearsNobody)
    assert held.of(events.ScriptEnded)
    assert script(held) == ("none", None)


def test_a_manager_that_only_advises_takes_no_script() -> None:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, 126, NOTHING, manager.now_ns, advise=True)
    manager.start(fly=False)
    reply = say(manager, FlyTarget(target()))
    assert (reply.done, reply.sentence) == (
        False, "this manager only advises: give the order to the active manager",
    )  # fmt: skip


def test_before_anything_runs_a_script_is_refused() -> None:
    manager = OneManager()
    manager.start(fly=False)
    assert "a reconfiguration is under way" in say(manager, FlyTarget(target())).sentence
    assert manager.core.now == Situation()
