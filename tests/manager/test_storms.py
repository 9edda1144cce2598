"""Changes that come faster than an epoch is prepared: they are gathered, and what is under way is finished first."""

import pytest

from heronry_manager import events
from heronry_manager.core.planning.storms import Storms
from heronry_manager.core.vocabulary import ClearElement, FailElement, OperatorSaid
from heronry_wire.state_frames import PeState
from manager.one_manager import MS, OneManager

STAGES_NS = 45 * MS  # from PREPARE to the answers of the PEs
UNUSED, USED = "device:servo_right", "device:servo_left"


class Storm:
    """A manager whose planner answers at once, and PEs that stage an epoch some time after PREPARE."""

    def __init__(self) -> None:
        self.manager = OneManager()
        self.manager.start(fly=False)
        self.flips, self.planned, self.taken = 0, 0, 0

    def flip(self, element: str) -> None:
        """Fail an element, or clear it."""
        self.flips += 1
        order = FailElement(element) if self.flips % 2 else ClearElement(element)
        self.manager.give(OperatorSaid(self.flips, order))

    def blow(self, element: str, for_ns: int, every_ns: int = 20 * MS) -> None:
        """Let an element fail and return in turn for some time."""
        end_ns = self.manager.now_ns + for_ns
        while self.manager.now_ns < end_ns:
            self.flip(element)
            self.look()
            self.manager.pass_time(every_ns)

    def rage(self, element: str) -> None:
        """Let an element fail and return until a change does not end what is being prepared any more."""
        abandoned = -1
        while abandoned != len(self.manager.of(events.EpochAbandoned)):
            abandoned = len(self.manager.of(events.EpochAbandoned))
            self.blow(element, 20 * MS)
        assert self.manager.core.status()["next"] is not None

    def look(self) -> None:
        """Do what is due: plan, stage, take steps."""
        manager = self.manager
        while self.planned < len(manager.requests):
            self.planned = len(manager.requests)
            manager.answer()
        opened = manager.of(events.EpochPrepared)
        open_ns = opened[-1].t_ns if opened else manager.now_ns
        is_open = bool(opened) and opened[-1].epoch not in {one.epoch for one in manager.of(events.EpochAbandoned)}
        if is_open and opened[-1].epoch != self.taken and manager.now_ns - open_ns >= STAGES_NS:
            self.taken = opened[-1].epoch
            for pe in manager.spec.pes:
                manager.stage(pe)
            for pe in manager.spec.pes:
                manager.take(pe, PeState.ACTIVE)

    def settle(self) -> None:
        """Let everything come to rest."""
        for _ in range(20):
            self.look()
            self.manager.pass_time(5 * MS)


def test_in_a_storm_an_epoch_is_reached_and_then_all_that_was_gathered_is_planned() -> None:
    storm = Storm()
    storm.blow(UNUSED, 900 * MS)
    assert storm.manager.of(events.Reconfigured) == []  # a burst: the newest situation is answered first
    assert len(storm.manager.of(events.EpochAbandoned)) > 40
    storm.blow(UNUSED, 400 * MS)
    assert len(storm.manager.of(events.Reconfigured)) == 1
    before = len(storm.manager.requests)
    storm.flip(UNUSED)
    storm.settle()
    asked = storm.manager.requests[before:]
    assert (UNUSED in asked[-1].now.down) is bool(storm.flips % 2)
    assert storm.manager.core.status()["epoch"] == storm.manager.last(events.Reconfigured).epoch


def test_what_becomes_illegal_ends_in_a_storm_too() -> None:
    storm = Storm()
    storm.blow(UNUSED, 900 * MS)
    storm.rage(UNUSED)
    abandoned = len(storm.manager.of(events.EpochAbandoned))
    storm.manager.give(OperatorSaid(999, ClearElement(UNUSED)))
    assert len(storm.manager.of(events.EpochAbandoned)) == abandoned
    storm.manager.give(OperatorSaid(1000, FailElement(USED)))
    assert len(storm.manager.of(events.EpochAbandoned)) == abandoned + 1
    storm.settle()
    assert storm.manager.requests[-1].now.down == {USED}
    assert storm.manager.core.status()["functions"]["elevator"]["served"]


def test_while_a_plan_is_awaited_changes_are_gathered_and_a_plan_that_they_made_illegal_is_made_again() -> None:
    storm = Storm()
    storm.blow(UNUSED, 900 * MS)
    storm.rage(UNUSED)
    manager = storm.manager
    manager.give(OperatorSaid(999, ClearElement(UNUSED)))
    manager.give(OperatorSaid(1000, FailElement(USED)))  # ends what is prepared: a plan is awaited
    asked = len(manager.requests)
    manager.give(OperatorSaid(1001, ClearElement(USED)))
    manager.give(OperatorSaid(1002, FailElement("device:servo_right")))
    assert len(manager.requests) == asked
    manager.answer()  # it drives the right servo
    assert len(manager.requests) == asked + 1
    assert manager.requests[-1].now.down == {UNUSED}


@pytest.mark.parametrize("running", [True, False])
def test_a_configuration_that_stops_a_critical_function_is_not_finished_first(running: bool) -> None:
    manager = OneManager()
    manager.start()
    serves = manager.core._known.deployment.current.configuration
    nothing = type(serves)({}, {}) if False else serves.__class__(modules={})
    storms, now = Storms(manager.spec, manager.core._turn), manager.requests[-1].now
    assert storms.may_finish(now, serves, None)
    assert storms.may_finish(now, nothing, serves if running else None) is not running
