"""What the operator says to a manager in flight, what PEs ask of it, and what it tells when it is asked."""

from typing import Any

import pytest

from heronry_dg.loader import loads
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
from heronry_wire.management import FORWARD_ONLY, Alive, Control, ElementKind, Emergency, FaultCode, Operation
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


def test_the_operator_enters_a_phase_and_a_plan_for_it_is_asked_for(manager: OneManager) -> None:
    assert "it was climb" in say(manager, EnterPhase("land")).sentence
    assert manager.requests[-1].now.phase == "land"
    assert manager.last("phase_changed")["by"] == "the operator"
    requests = len(manager.requests)
    assert say(manager, EnterPhase("land")).done
    assert len(manager.requests) == requests
    assert status(manager)["phase"] == "land"


def test_a_phase_that_there_is_not_is_refused_with_what_there_is(manager: OneManager) -> None:
    reply = say(manager, EnterPhase("glied"))
    assert not reply.done
    assert "did you mean 'glide'" in reply.sentence


def test_a_request_is_acknowledged_each_time_and_counts_once(manager: OneManager) -> None:
    manager.report("left", request(2, 1))
    say(manager, EnterPhase("climb"))
    manager.report("left", request(2, 1))
    told = manager.answers()
    assert [(c.operation, c.a, c.b) for c in told] == [(Operation.ACKNOWLEDGE, ElementKind.PHASE, 1)] * 2
    assert [one["phase"] for one in manager.of("phase_changed")] == ["land", "climb"]


def test_a_rule_only_leads_on_and_a_module_may_lead_back(manager: OneManager) -> None:
    manager.report("left", request(2, FORWARD_ONLY | 1))
    manager.report("left", request(1, FORWARD_ONLY | 2))
    assert status(manager)["phase"] == "land"
    manager.report("left", request(1, 3))
    assert status(manager)["phase"] == "glide"


def test_who_is_not_counted_on_is_not_heard_and_may_count_anew_when_it_is(manager: OneManager) -> None:
    manager.report("left", request(1, 1))
    manager.reboot("left")
    manager.commands.clear()
    manager.report("left", request(2, 1))
    assert manager.answers() == []
    manager.pass_time(HOLD_DOWN_NS + BEAT_NS)
    manager.report("left", request(2, 1))
    assert status(manager)["phase"] == "land"


def test_a_phase_that_the_spec_does_not_have_is_no_request(manager: OneManager) -> None:
    manager.report("left", request(9, 1))
    assert manager.answers() == []


# Faults


def test_an_element_that_the_operator_fails_is_planned_without_until_he_clears_it(manager: OneManager) -> None:
    assert say(manager, FailElement("device:servo_left")).done
    assert manager.requests[-1].now.down == {"device:servo_left"}
    assert "already" in say(manager, FailElement("device:servo_left")).sentence
    assert [one["element"] for one in status(manager)["latched"]] == ["device:servo_left"]
    assert say(manager, ClearElement("device:servo_left")).done
    assert manager.requests[-1].now.down == set()
    assert manager.answers()[-1] == Control(1, 0, Operation.CLEAR, ElementKind.DEVICE, 0)
    assert status(manager)["latched"] == []


@pytest.mark.parametrize("stopped", [True, False])
def test_a_module_that_was_stopped_and_is_cleared_before_a_plan_runs_again_with_a_new_epoch(
    manager: OneManager, stopped: bool
) -> None:
    module = list(manager.spec.modules).index("control")
    if stopped:
        manager.report("middle", Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, module, 0))
    else:
        say(manager, FailElement("module:control"))
    assert say(manager, ClearElement("module:control")).done
    epoch, _ = manager.prepared()
    manager.answer()
    assert (manager.prepared()[0] > epoch) is stopped
    assert len(manager.of("plan_unchanged")) == (not stopped)


def test_the_managers_own_bus_cannot_be_failed_and_whoever_reports_it_was_heard_there(manager: OneManager) -> None:
    asked = len(manager.requests)
    reply = say(manager, FailElement("bus:can0"))
    assert not reply.done
    assert "name what has failed on it" in reply.sentence
    manager.report("left", Emergency(FaultCode.REPORTED, 0x81, ElementKind.BUS, 0, 0))
    assert [one["element"] for one in status(manager)["latched"]] == ["bus:can0"]
    assert all("bus:can0" not in request.now.down for request in manager.requests[asked:])


def test_a_cleared_fault_that_is_reported_again_is_latched_again(manager: OneManager) -> None:
    manager.report("left", LEFT_SERVO_FAILED)
    say(manager, ClearElement("device:servo_left"))
    manager.report("left", LEFT_SERVO_FAILED)
    assert len(manager.of("fault_reported")) == 2
    assert manager.requests[-1].now.down == {"device:servo_left"}


@pytest.mark.parametrize("element", ["device:servo_left", "pe:left", "module:control"])
def test_what_nothing_is_held_against_cannot_be_cleared(manager: OneManager, element: str) -> None:
    reply = say(manager, ClearElement(element))
    assert not reply.done
    assert "nothing is latched" in reply.sentence


def test_an_element_that_there_is_not_is_refused(manager: OneManager) -> None:
    for order in (FailElement("pe:lefft"), ClearElement("servo")):
        assert not say(manager, order).done
    assert len(manager.requests) == 1


def test_a_pe_that_the_operator_fails_speaks_in_vain_until_it_is_cleared(manager: OneManager) -> None:
    say(manager, FailElement("pe:left"))
    assert manager.requests[-1].now.down == {"pe:left"}
    manager.pass_time(10 * HOLD_DOWN_NS)
    assert 92 not in manager.said(Alive)[-1].nodes
    pe = status(manager)["pes"]["left"]
    assert (pe["state"], pe["why"]) == ("down", "failed, reported by the operator")
    assert "hold-down" in say(manager, ClearElement("pe:left")).sentence
    manager.pass_time(HOLD_DOWN_NS + 2 * BEAT_NS)
    assert manager.last("pe_joined")["pe"] == "left"
    assert manager.requests[-1].now.down == set()


def test_a_pe_that_is_down_already_can_be_failed_as_well(manager: OneManager) -> None:
    manager.die("left")
    manager.pass_time(100 * MS)
    requests = len(manager.requests)
    assert say(manager, FailElement("pe:left")).done
    assert len(manager.requests) == requests + 1
    manager.live("left")
    manager.pass_time(2 * HOLD_DOWN_NS)
    assert manager.requests[-1].now.down == {"pe:left"}


def test_clearing_ends_a_quarantine(manager: OneManager) -> None:
    for _ in range(5):
        manager.reboot("right")
        while not manager.of("pe_joined") or manager.last("pe_joined")["t_ns"] < manager.last("pe_heard_again")["t_ns"]:
            manager.pass_time(HOLD_DOWN_NS)
    manager.reboot("right")
    manager.pass_time(2 * BEAT_NS)
    assert status(manager)["pes"]["right"]["held_down_for_ns"] > 10 * HOLD_DOWN_NS
    assert say(manager, ClearElement("pe:right")).done
    manager.pass_time(HOLD_DOWN_NS + BEAT_NS)
    assert manager.last("pe_joined")["t_ns"] > manager.now_ns - 2 * HOLD_DOWN_NS
    assert status(manager)["pes"]["right"]["state"] == "up"


def test_a_channel_is_not_failed_for_nothing_would_be_planned_otherwise(manager: OneManager) -> None:
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


def test_orders_wait_until_the_manager_reigns_and_a_question_does_not() -> None:
    manager = OneManager()
    assert "try again" in say(manager, FailElement("pe:left")).sentence
    told = status(manager)
    assert (told["manager"]["state"], told["epoch"], told["buses"]) == ("listening", None, {})
    assert told["functions"]["elevator"]["why_not"] == "nothing runs yet"


def test_the_status_tells_what_runs_what_is_served_and_what_nobody_watches(manager: OneManager) -> None:
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


def test_a_pe_is_unlocked_by_name_where_there_is_a_key(manager: OneManager) -> None:
    assert "has no key" in say(manager, UnlockPe("pe:left")).sentence
    keyed = OneManager(key=Key(b"k" * 32))
    keyed.pass_time(6 * BEAT_NS)
    assert "name a PE, such as pe:left" in say(keyed, UnlockPe("module:control")).sentence
    assert say(keyed, UnlockPe("pe:left")).sentence == "NMT and SDO may write on pe:left for 30 s"
    assert Control(1, 92, Operation.UNLOCK, 30) in keyed.commands


def test_who_only_advises_unlocks_nothing() -> None:
    core = ManagerCore(two_tails(), 126, NOTHING, 0, advise=True, key=Key(b"k" * 32))
    core.step(6 * BEAT_NS, Tick())
    (reply,) = core.step(6 * BEAT_NS, OperatorSaid(1, UnlockPe("pe:left")))
    assert isinstance(reply, Reply)
    assert (reply.done, reply.sentence) == (False, "this manager only advises: say it to the one that reigns")


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


# Requests for a phase, over losses and reigns


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
    assert [one["phase"] for one in manager.of("phase_changed")] == ["land", "climb"]


def test_of_two_requests_the_later_one_counts_in_whatever_order_they_come(manager: OneManager) -> None:
    manager.report("left", request(2, 2))
    manager.report("left", request(1, 1))
    assert status(manager)["phase"] == "land"
    assert len(manager.answers()) == 2


def test_the_phase_is_told_before_the_request_for_it_is_acknowledged(manager: OneManager) -> None:
    manager.pass_time(10 * BEAT_NS)
    manager.commands.clear()
    manager.report("left", request(2, 1))
    told = [(one.operation, one.b) for one in manager.said(Control)]
    assert told == [(Operation.HOLDS, 2), (Operation.ACKNOWLEDGE, 1)]


def test_a_restarted_manager_knows_which_request_was_obeyed(manager: OneManager) -> None:
    manager.report("left", request(2, 1))
    say(manager, EnterPhase("climb"))
    again = OneManager(manager.spec, memory=manager.memory)
    again.running = dict(manager.running)
    again.start(fly=False)
    again.report("left", request(2, FORWARD_ONLY | 1))
    assert again.of("phase_changed") == []
    again.report("left", request(1, 2))
    assert again.last("phase_changed")["phase"] == "glide"
