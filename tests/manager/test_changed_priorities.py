"""Priorities that the operator or a module changes: what is refused and remembered, what a standby manager knows."""

from typing import Any

import pytest

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.situation.changed_priorities import CHANGE_NS
from heronry_manager.core.vocabulary import OperatorSaid, Reply, SetPriority
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import (
    PRIORITY_REQUEST_NUMBERS,
    SPECS_PRIORITY,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Operation,
)
from heronry_wire.protocol_times import ANNOUNCED_EVERY
from manager.one_manager import BEAT_NS, SPEC_TEXT, OneManager

FUNCTIONS = """
  elevator: {output: elevator_out, criticality: A, priority: 100, priority_range: [50, 200]}
  trim: {output: elevator_out, criticality: B}
"""
SPEC = loads(SPEC_TEXT.split("  elevator: {output")[0] + FUNCTIONS.lstrip("\n"), "two_tails.dg.yaml")
ELEVATOR, TRIM = range(2)


@pytest.fixture
def manager() -> OneManager:
    return flying()


def flying(**options: Any) -> OneManager:
    found = OneManager(SPEC, **options)
    found.start()
    return found


def request(function: int, number: int, priority: int) -> Emergency:
    index = function * PRIORITY_REQUEST_NUMBERS + number
    return Emergency(FaultCode.PRIORITY_REQUEST, 0, ElementKind.PRIORITY, index, priority)


def order(manager: OneManager, function: str, priority: int | None) -> Reply:
    (reply,) = (a for a in manager.give(OperatorSaid(7, SetPriority(function, priority))) if isinstance(a, Reply))
    return reply


def acknowledged(manager: OneManager, emergency: Emergency) -> bool:
    """Report an emergency of `left`, and tell whether it is acknowledged."""
    before = len(manager.commands)
    manager.report("left", emergency)
    told = Control(manager.core.term, 92, Operation.ACKNOWLEDGE, ElementKind.PRIORITY, emergency.index)
    return told in manager.commands[before:]


def priorities(manager: OneManager) -> dict[str, int]:
    return {name: one["priority"] for name, one in manager.core.status()["priorities"].items()}


def test_a_request_changes_the_priority_and_the_plan_is_made_for_it(manager: OneManager) -> None:
    assert acknowledged(manager, request(ELEVATOR, 1, 60))
    assert manager.requests[-1].now.priorities == {"elevator": 60}
    assert manager.core.status()["functions"]["elevator"]["priority"] == 60
    manager.pass_time(CHANGE_NS)
    assert acknowledged(manager, request(ELEVATOR, 2, SPECS_PRIORITY))
    assert priorities(manager) == {}


def test_at_most_one_change_a_second_and_the_last_request_counts(manager: OneManager) -> None:
    assert acknowledged(manager, request(ELEVATOR, 1, 60))
    assert not acknowledged(manager, request(ELEVATOR, 2, 70))
    assert not acknowledged(manager, request(ELEVATOR, 3, 80))
    assert acknowledged(manager, request(ELEVATOR, 4, 60))  # no change
    manager.pass_time(CHANGE_NS)
    assert acknowledged(manager, request(ELEVATOR, 5, 80))
    assert priorities(manager) == {"elevator": 80}


def test_a_request_outside_the_range_is_refused_and_told(manager: OneManager) -> None:
    for number, (function, priority) in enumerate(((ELEVATOR, 49), (ELEVATOR, 201), (TRIM, 1))):
        assert acknowledged(manager, request(function, number, priority))
    assert priorities(manager) == {}
    assert [one.why for one in manager.of(events.PriorityRefused)] == [
        "its priority_range is 50 to 200",
        "its priority_range is 50 to 200",
        "the spec gives it no priority_range",
    ]


def test_a_request_that_comes_again_or_late_has_no_effect(manager: OneManager) -> None:
    manager.report("left", request(ELEVATOR, 5, 60))
    order(manager, "elevator", None)
    for number in (5, 4):
        assert acknowledged(manager, request(ELEVATOR, number, 60))
    assert priorities(manager) == {}
    assert not acknowledged(manager, request(9, 6, 60))  # no such function


def test_the_operators_order_stands_until_the_operator_ends_it(manager: OneManager) -> None:
    assert "the priority of elevator is 300 from now on" in order(manager, "elevator", 300).sentence
    assert order(manager, "elevator", 300).sentence == "the priority of elevator is 300 already"
    assert acknowledged(manager, request(ELEVATOR, 1, 60))
    assert acknowledged(manager, request(ELEVATOR, 2, SPECS_PRIORITY))
    assert priorities(manager) == {"elevator": 300}
    assert order(manager, "elevator", None).done
    assert order(manager, "elevator", None).sentence == "the priority of elevator is that of the spec already"


@pytest.mark.parametrize(
    ("function", "priority", "sentence"),
    [
        ("elevater", 3, "no function is named 'elevater'; did you mean 'elevator'?"),
        ("elevator", -1, "a priority is a whole number from 0 to 32767, not -1"),
        ("elevator", 32768, "a priority is a whole number from 0 to 32767, not 32768"),
    ],
)
def test_an_order_that_cannot_be_is_refused(manager: OneManager, function: str, priority: int, sentence: str) -> None:
    assert (order(manager, function, priority).done, order(manager, function, priority).sentence) == (False, sentence)


def test_a_function_that_no_command_can_name_is_refused() -> None:
    many = "".join(f"  f{i}: {{output: elevator_out}}\n" for i in range(256))
    spec = loads(SPEC_TEXT + many, "many.dg.yaml")
    late = OneManager(spec)
    late.start()
    assert order(late, "f254", 3).done
    assert "commands can name only the first 256 functions" in order(late, "f255", 3).sentence


def test_priorities_and_requests_outlive_a_restart(manager: OneManager) -> None:
    manager.report("left", request(ELEVATOR, 3, 60))
    order(manager, "trim", 9)
    order(manager, "trim", None)
    order(manager, "trim", 8)
    after = flying(memory=manager.memory)
    assert priorities(after) == {"elevator": 60, "trim": 8}
    order(after, "elevator", None)
    after.report("left", request(ELEVATOR, 3, 60))
    assert priorities(after) == {"trim": 8}


class Pair:
    """An active manager, and a standby manager that hears it and the same PEs."""

    def __init__(self) -> None:
        self.first, self.second = flying(), OneManager(SPEC, node=127)
        self.second.core = ManagerCore(SPEC, 127, NOTHING, self.second.now_ns, standby=True)
        self.second.memory = NOTHING
        self.told = len(self.first.frames)
        self.second.running = dict(self.first.running)
        self.fly(10)

    def fly(self, beats: int) -> None:
        for _ in range(beats):
            self.first.pass_time(BEAT_NS)
            self.share()
            self.second.pass_time(BEAT_NS)

    def share(self) -> None:
        for frame in self.first.frames[self.told :]:
            self.second.hear(frame)
        self.told = len(self.first.frames)

    def drop(self) -> None:
        """The standby manager does not hear what was sent."""
        self.told = len(self.first.frames)


def test_a_standby_manager_knows_the_priorities_and_which_requests_were_executed() -> None:
    pair = Pair()
    pair.first.report("left", request(ELEVATOR, 3, 60))
    order(pair.first, "trim", 9)
    pair.share()
    assert priorities(pair.second) == {"elevator": 60, "trim": 9}
    assert [one.number for one in pair.second.memory.priority_requests.values()] == [3]
    order(pair.first, "trim", None)
    order(pair.first, "elevator", None)
    pair.share()
    assert priorities(pair.second) == {}


def test_a_standby_manager_that_missed_it_hears_it_in_turn_and_forgets_what_it_hears_no_more() -> None:
    pair = Pair()
    pair.first.report("left", request(ELEVATOR, 3, 60))
    pair.drop()
    pair.fly(2 * ANNOUNCED_EVERY)
    assert priorities(pair.second) == {"elevator": 60}
    assert [one.number for one in pair.second.memory.priority_requests.values()] == [3]
    order(pair.first, "trim", 9)
    pair.fly(1)
    order(pair.first, "trim", None)
    pair.drop()
    pair.fly(12 * ANNOUNCED_EVERY)
    assert priorities(pair.second) == {"elevator": 60}
    assert pair.second.last(events.PriorityChanged).by == "the active manager, which no longer announces it"


def test_what_another_manager_tells_of_no_function_of_the_spec_has_no_effect() -> None:
    pair = Pair()
    for operation in (Operation.HOLDS, Operation.CLEAR):
        told = Control(pair.first.core.term, 0, operation, ElementKind.PRIORITY | 9 << 8, 3)
        pair.second.hear(Frame(management_id(126, Command.CONTROL), told.encode()))
    answer = Control(pair.first.core.term, 92, Operation.ACKNOWLEDGE, ElementKind.PRIORITY, 9 << 8 | 3)
    pair.second.hear(Frame(management_id(126, Command.CONTROL), answer.encode()))
    assert priorities(pair.second) == {}
    assert pair.second.memory.priority_requests == {}
