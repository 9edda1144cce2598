"""A manager that only advises: it receives and plans like any other manager, and sends no command."""

from typing import Any

import pytest

from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.vocabulary import ClearElement, EnterPhase, FailElement, OperatorSaid, Order, Reply
from heronry_manager.planner.exact import plan
from heronry_wire.frame import Frame
from heronry_wire.management import (
    FORWARD_ONLY,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    Prepare,
    Step,
)
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage1
from lab.peers import command_frame, slice_messages
from manager.one_manager import BEAT_NS, MS, OneManager
from manager.test_standby import PHASES

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)


@pytest.fixture
def advisor() -> OneManager:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, manager.node, NOTHING, manager.now_ns, advise=True)
    return manager


def do_as_advised(advisor: OneManager, epoch: int) -> None:
    """Let another manager deploy what was advised."""
    request = advisor.requests[-1]
    plan = advisor.answer()
    digest = advisor.compiler.configuration(plan.configuration).digest
    assert advisor.requests[-1] == request
    for pe in list(advisor.running):
        advisor.live(pe, PeState.ACTIVE, epoch=epoch, digest=digest)


def test_it_tells_what_it_would_do_and_sends_nothing_on_the_bus(advisor: OneManager) -> None:
    advisor.start(fly=False)
    do_as_advised(advisor, 30)
    assert advisor.last(events.Advice).started == ("control", "drive_left")
    assert advisor.last(events.Adopted).epoch == 30
    advisor.die("left")
    advisor.pass_time(100 * MS)
    do_as_advised(advisor, 31)
    assert advisor.last(events.Advice).started == ("drive_right",)
    assert advisor.last(events.Adopted).epoch == 31
    assert advisor.frames == []
    assert advisor.of(events.EpochPrepared) == []


def test_a_manager_that_is_active_beside_it_is_no_rival(advisor: OneManager) -> None:
    lease = Lease(9, 0, Step.PREPARED, 0)
    advisor.hear(command_frame(lease, 127))
    advisor.start(fly=False)
    assert advisor.requests == []  # the other manager announces in turn what it holds
    advisor.pass_time(1000 * MS)
    assert advisor.stops == []
    assert advisor.requests


def test_what_another_manager_does_otherwise_is_not_held_against_a_pe(advisor: OneManager) -> None:
    advisor.start(fly=False)
    do_as_advised(advisor, 30)
    for pe in advisor.spec.pes:
        advisor.live(pe, PeState.ACTIVE, epoch=31, digest=5)
    advisor.hear(
        Frame(advisor.state_id("left"), StatePage1(PeState.ACTIVE, PeFlags(0), 31, 0, Reason.IMAGE, 0).encode())
    )
    assert advisor.of(events.PeLost) == []
    advisor.report("left", LEFT_SERVO_FAILED)
    assert advisor.requests[-1].running is None
    assert advisor.frames == []


def test_what_was_advised_is_adopted_once_every_pe_is_active_in_it(advisor: OneManager) -> None:
    advisor.start(fly=False)
    digest = advisor.compiler.configuration(advisor.answer().configuration).digest
    for state in (PeState.PARTIAL, PeState.ACTIVE):
        assert advisor.of(events.Adopted) == []
        for pe in advisor.spec.pes:
            advisor.live(pe, state, epoch=30, digest=digest)
    assert advisor.last(events.Adopted).epoch == 30


# Beside an active manager, in flight


class Beside:
    """One that only advises, started while 127 is active in term 2 and its PEs run an epoch; time passes by `fly`."""

    def __init__(self) -> None:
        self.one = OneManager(PHASES)
        self.one.core = ManagerCore(PHASES, 126, NOTHING, self.one.now_ns, advise=True)
        self.lease = Lease(2, 0, Step.PREPARED, 0)
        self.holds: list[tuple[ElementKind, int]] = []
        self._beats = 0

    def say(self, *messages: ManagementMessage) -> None:
        self.one.hear(*(command_frame(message, 127) for message in messages))

    def run(self, found: Plan | None, epoch: int) -> None:
        """Let all PEs run a plan, or something unknown here, and let the manager send LEASEs for it."""
        digest = 0x99 if found is None else self.one.compiler.configuration(found.configuration).digest
        self.lease = Lease(2, epoch, Step.GO_ALL, digest)
        for pe in PHASES.pes:
            self.one.live(pe, PeState.ACTIVE, epoch=epoch, digest=digest)

    def deploy(self, found: Plan, epoch: int) -> None:
        """Let all PEs run a plan, and let the manager send its slices too: it may be overheard."""
        self.activate(found, epoch)
        self.run(found, epoch)

    def activate(self, found: Plan, epoch: int) -> None:
        """Let the manager send all of a reconfiguration, which no PE has executed yet."""
        compiled = self.one.compiler.configuration(found.configuration)
        for node, body in compiled.slices.items():
            self.say(*([Prepare(2, epoch, compiled.digest)] if node == 92 else []))
            self.say(*slice_messages(node, epoch, body, Compiler(PHASES).identities[node]))
        self.say(*(said(2, epoch, Step.GO_ALL, compiled.digest) for said in (Activate, Lease)))

    def fly(self, beats: int) -> None:
        for _ in range(beats):
            self._beats += 1
            self.say(self.lease, Alive(2, self._beats % 256, frozenset((92, 93, 94))))
            if self.holds and self._beats % 5 == 0:
                self.say(Control(2, 0, Operation.HOLDS, *self.holds[self._beats // 5 % len(self.holds)]))
            self.one.pass_time(BEAT_NS)

    def status(self) -> dict[str, Any]:
        return self.one.core.status()

    def accept(self, order: Order) -> Reply:
        (reply,) = (action for action in self.one.give(OperatorSaid(7, order)) if isinstance(action, Reply))
        return reply


@pytest.fixture
def beside() -> Beside:
    return Beside()


def without(*down: str, phase: str = "climb") -> Plan:
    return plan(PHASES, Situation(frozenset(down), {}, phase), None)


def test_what_another_manager_holds_is_known_before_the_first_plan(beside: Beside) -> None:
    beside.holds = [(ElementKind.PHASE, 1), (ElementKind.DEVICE, 0)]
    beside.run(without("device:servo_left", phase="glide"), 30)
    beside.fly(60)
    assert [(one.now.down, one.now.phase) for one in beside.one.requests] == [
        (frozenset({"device:servo_left"}), "glide")
    ]
    beside.one.answer()
    assert beside.one.of(events.Advice) == []
    assert (beside.status()["epoch"], beside.status()["stage"]) == (30, "done")
    assert [one["by"] for one in beside.status()["latched"]] == ["manager 127"]
    beside.say(Control(2, 0, Operation.CLEAR, ElementKind.DEVICE, 0))
    assert beside.status()["latched"] == []
    assert beside.one.requests[-1].now.down == frozenset()


def test_what_runs_and_is_not_known_is_called_so_until_the_next_epoch(beside: Beside) -> None:
    beside.run(None, 30)
    beside.fly(60)
    beside.one.answer()
    assert beside.one.last(events.UnknownEpoch).epoch == 30
    assert (beside.status()["epoch"], beside.status()["unknown_epoch"]) == (None, 30)
    elevator = beside.status()["functions"]["elevator"]
    assert (elevator["served"], elevator["value"]) == (None, None)
    assert elevator["why_not"] == "epoch 30 runs, which this manager does not know"
    beside.deploy(without("device:servo_left"), 31)
    beside.fly(10)
    assert (beside.status()["epoch"], beside.status()["unknown_epoch"]) == (31, None)
    assert beside.status()["functions"]["elevator"]["served"] is True
    assert beside.one.requests[-1].running == {"control": ("only", "left"), "drive_right": ("only", "right")}
    assert beside.one.of(events.Advice) == []


def test_nothing_is_reported_of_what_is_overheard_and_runs_nowhere_yet(beside: Beside) -> None:
    beside.run(None, 30)
    beside.fly(60)
    beside.activate(without("device:servo_left"), 31)
    beside.one.answer()
    assert (beside.one.of(events.UnknownEpoch), beside.one.of(events.Advice)) == ([], [])


def test_it_advises_from_what_another_manager_has_deployed(beside: Beside) -> None:
    beside.run(without(), 30)
    beside.fly(60)
    beside.one.answer()
    beside.deploy(without("device:servo_left", "device:servo_right"), 31)  # without a fault that was announced
    beside.fly(10)
    assert beside.status()["functions"]["elevator"]["served"] is False
    beside.one.answer()
    assert beside.one.last(events.Advice).started == ("control", "drive_left")
    beside.run(without(), 32)
    beside.fly(1)
    assert beside.status()["epoch"] == 32
    assert beside.one.requests[-1].running == {}
    assert beside.one.frames == []


def test_what_the_operator_supposes_is_not_what_another_manager_holds(beside: Beside) -> None:
    beside.holds = [(ElementKind.PHASE, 0)]
    beside.run(without(), 30)
    beside.fly(60)
    beside.one.answer()
    replies = [beside.accept(FailElement("device:servo_left")), beside.accept(EnterPhase("land"))]
    beside.fly(100)
    assert [one["element"] for one in beside.status()["latched"]] == ["device:servo_left"]
    assert beside.status()["phase"] == "land"
    beside.holds = [(ElementKind.PHASE, 1)]
    beside.fly(10)
    assert beside.status()["phase"] == "glide"
    replies.append(beside.accept(ClearElement("device:servo_left")))
    assert beside.status()["latched"] == []
    only_advises = "; this manager only advises: give the order to the active manager"
    assert [(one.done, one.sentence) for one in replies] == [
        (True, "device:servo_left counts as failed until it is cleared" + only_advises),
        (True, "the phase is land from now on, it was climb" + only_advises),
        (True, "device:servo_left no longer counts as failed" + only_advises),
    ]


def test_a_request_for_a_phase_is_left_to_the_active_manager_as_long_as_there_is_one(beside: Beside) -> None:
    beside.run(without(), 30)
    beside.fly(60)
    request = Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, 1, FORWARD_ONLY | 1)
    beside.one.report("left", request)
    assert beside.status()["phase"] == "climb"
    beside.one.pass_time(6 * BEAT_NS)
    beside.one.report("left", request)
    assert beside.status()["phase"] == "glide"
