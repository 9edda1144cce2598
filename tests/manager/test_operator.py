"""The operator's orders to a flying manager, the PEs' requests to it, and its status."""

from typing import Any

import pytest

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING, Latched
from heronry_manager.core.vocabulary import (
    AskStatus,
    ClearElement,
    EnterPhase,
    FailElement,
    OperatorSaid,
    Order,
    Reply,
    UnlockPe,
)
from heronry_wire.authentication import Key
from heronry_wire.management import FORWARD_ONLY, ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import HOLD_DOWN_PERIODS
from heronry_wire.sansio import Tick
from heronry_wire.state_frames import PeState
from manager.one_manager import BEAT_NS, MS, SPEC_TEXT, OneManager, two_tails

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)
PHASES = "phases: {climb: {}, glide: {when: {variable: demand, above: 2.0}}, land: {}}\n"
HOLD_DOWN_NS = HOLD_DOWN_PERIODS * BEAT_NS


@pytest.fixture
def manager() -> OneManager:
    flying = OneManager(loads(SPEC_TEXT + PHASES, "phases.dg.yaml"))
    flying.start()
    return flying


def say(manager: OneManager, order: Order) -> Reply:
    (reply,) = (action for action in manager.give(OperatorSaid(7, order)) if isinstance(action, Reply))
    assert reply.number == 7
    return reply


def status(manager: OneManager) -> dict[str, Any]:
    reply = say(manager, AskStatus())
    assert reply.status is not None
    return dict(reply.status)


def request(phase: int, detail: int) -> Emergency:
    return Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, phase, detail)


# Phases


def test_an_unknown_phase_is_refused_with_the_nearest_name(manager: OneManager) -> None:
    reply = say(manager, EnterPhase("glied"))
    assert not reply.done
    assert "did you mean 'glide'" in reply.sentence


# Faults


@pytest.mark.parametrize("stopped", [True, False])
def test_a_module_that_was_stopped_and_is_cleared_before_a_plan_runs_again_with_a_new_epoch(
    manager: OneManager, stopped: bool
) -> None:
    module = list(manager.spec.modules).index("control")
    if stopped:
        manager.report("left", Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, module, 0))
    else:
        say(manager, FailElement("module:control"))
    assert say(manager, ClearElement("module:control")).done
    epoch, _ = manager.prepared()
    manager.answer()
    assert (manager.prepared()[0] > epoch) is stopped
    assert len(manager.of(events.PlanUnchanged)) == (not stopped)


def test_who_clears_one_place_of_a_module_that_has_failed_everywhere_is_told_what_to_clear(manager: OneManager) -> None:
    module = list(manager.spec.modules).index("control")
    failed = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, module, 0)
    manager.report("left", failed)
    manager.report("right", failed)
    assert {"module:control@left", "module:control"} <= manager.requests[-1].now.down
    for done in (True, False):
        reply = say(manager, ClearElement("module:control@left"))
        assert reply.done is done
        assert reply.sentence.endswith("module:control counts as failed on every PE: clear module:control")


def test_a_cleared_fault_that_is_reported_again_is_latched_again(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    say(manager, ClearElement("device:servo_left"))
    manager.report("left", LEFT_SERVO_FAILED)
    assert len(manager.of(events.FaultReported)) == 2
    assert manager.requests[-1].now.down == {"device:servo_left"}


def test_a_pe_that_is_down_already_can_be_failed_as_well(manager: OneManager) -> None:
    manager.die("left")
    manager.pass_time(100 * MS)
    requests = len(manager.requests)
    assert say(manager, FailElement("pe:left")).done
    assert len(manager.requests) == requests + 1
    manager.live("left")
    manager.pass_time(2 * HOLD_DOWN_NS)
    assert manager.requests[-1].now.down == {"pe:left"}


def test_a_channel_is_not_failed_since_the_plan_would_be_the_same(manager: OneManager) -> None:
    text = SPEC_TEXT.replace("{bitrate: 1000000}", "{bitrate: 1000000, channels: 2}")
    twice = OneManager(loads(text, "twice.dg.yaml"))
    twice.start()
    for channel in ("channel:can0.1", "channel:can0.2"):
        reply = say(twice, FailElement(channel))
        assert (reply.done, "name the bus if all of them have failed" in reply.sentence) == (False, True)
    assert twice.requests[-1].now.down == frozenset()
    assert not say(twice, ClearElement("channel:can0.1")).done


def test_a_channel_that_an_older_journal_holds_is_cleared_and_no_pe_is_told() -> None:
    text = SPEC_TEXT.replace("{bitrate: 1000000}", "{bitrate: 1000000, channels: 2}")
    twice = OneManager(
        loads(text, "twice.dg.yaml"), memory=NOTHING.after(Latched("channel:can0.1", "x", "OPERATOR", 0))
    )
    twice.start()
    assert say(twice, ClearElement("channel:can0.1")).done
    assert twice.answers() == []


# Status, and when


def test_orders_wait_until_the_manager_is_active_and_a_question_does_not() -> None:
    manager = OneManager()
    assert "try again" in say(manager, FailElement("pe:left")).sentence
    told = status(manager)
    assert (told["manager"]["state"], told["epoch"], told["buses"]) == ("listening", None, {})
    assert told["functions"]["elevator"]["why_not"] == "nothing runs yet"


def test_the_status_tells_what_runs_what_is_served_and_which_phases_no_pe_watches(manager: OneManager) -> None:
    told = status(manager)
    assert (told["epoch"], told["stage"], told["next"]) == (1, "done", None)
    assert told["pes"]["left"] == {
        "state": "up",
        "why": None,
        "epoch": 1,
        "runs": "ACTIVE",
        "losses": 0,
        "held_down_for_ns": None,
        "authentic": None,
        "standstills": None,
        "cost": None,
        "held": None,
    }
    assert told["functions"]["elevator"]["served"]
    assert told["buses"]["can0"]["bits_per_s"] == 0
    assert told["unwatched"] == []
    for device in ("device:servo_left", "device:servo_right"):
        say(manager, FailElement(device))
    manager.answer()
    for pe in manager.spec.pes:
        manager.stage(pe)
    for pe in manager.spec.pes:
        manager.take(pe, PeState.ACTIVE)
    told = status(manager)
    assert not told["functions"]["elevator"]["served"]
    assert told["unwatched"] == ["glide"]


# The lock


def test_a_manager_that_only_advises_unlocks_nothing() -> None:
    core = ManagerCore(two_tails(), 126, NOTHING, 0, advise=True, key=Key(b"k" * 32))
    core.step(6 * BEAT_NS, Tick())
    (reply,) = core.step(6 * BEAT_NS, OperatorSaid(1, UnlockPe("pe:left")))
    assert isinstance(reply, Reply)
    assert (reply.done, reply.sentence) == (False, "this manager only advises: give the order to the active manager")


def test_what_its_pe_gives_up_after_the_operator_has_failed_it_runs_again_with_a_new_epoch(manager: OneManager) -> None:
    module = list(manager.spec.modules).index("control")
    say(manager, FailElement("module:control"))
    manager.report("middle", Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, module, 0))
    assert manager.memory.latched["module:control"].by == "middle"
    say(manager, FailElement("module:control"))
    assert manager.memory.latched["module:control"].by == "middle"
    epoch, _ = manager.prepared()
    assert say(manager, ClearElement("module:control")).done
    manager.answer()
    assert manager.prepared()[0] != epoch


# Requests for a phase, over losses and masterships


def test_a_request_counts_once_though_its_pe_was_lost_before_it_was_answered(manager: OneManager) -> None:
    manager.report("left", request(2, 1))
    state = manager.running["left"]
    manager.die("left")
    manager.pass_time(5 * BEAT_NS)
    say(manager, EnterPhase("climb"))
    manager.running["left"] = state
    manager.beat("left")
    manager.pass_time(HOLD_DOWN_NS + 2 * BEAT_NS)
    manager.report("left", request(2, 1))
    assert [one.phase for one in manager.of(events.PhaseChanged)] == ["land", "climb"]


def test_a_restarted_manager_knows_which_request_was_accepted(manager: OneManager) -> None:
    manager.report("left", request(2, 1))
    say(manager, EnterPhase("climb"))
    again = OneManager(manager.spec, memory=manager.memory)
    again.running = dict(manager.running)
    again.start(fly=False)
    again.report("left", request(2, FORWARD_ONLY | 1))
    assert again.of(events.PhaseChanged) == []
    again.report("left", request(1, 2))
    assert again.last(events.PhaseChanged).phase == "glide"
