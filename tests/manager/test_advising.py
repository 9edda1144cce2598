"""A manager that only advises: it hears and plans like any other, and commands nothing."""

import pytest

from heronry_manager.core import ManagerCore
from heronry_manager.memory import NOTHING
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import ElementKind, Emergency, FaultCode, Lease, PeFlags, PeState, Reason, StatePage1, Step
from manager.one_manager import MS, OneManager

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)


@pytest.fixture
def advisor() -> OneManager:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, manager.node, NOTHING, manager.now_ns, advise=True)
    return manager


def do_as_advised(advisor: OneManager, epoch: int) -> None:
    """Another manager brings about what was advised."""
    request = advisor.requests[-1]
    plan = advisor.answer()
    digest = advisor.compiler.configuration(plan.configuration).digest
    assert advisor.requests[-1] == request
    for pe in list(advisor.running):
        advisor.live(pe, PeState.ACTIVE, epoch=epoch, digest=digest)


def test_it_says_what_it_would_do_and_nothing_on_the_bus(advisor: OneManager) -> None:
    advisor.start(fly=False)
    do_as_advised(advisor, 30)
    assert advisor.last("advice")["started"] == ["control", "drive_left"]
    assert advisor.last("adopted")["epoch"] == 30
    advisor.die("left")
    advisor.pass_time(100 * MS)
    do_as_advised(advisor, 31)
    assert advisor.last("advice")["started"] == ["drive_right"]
    assert advisor.last("adopted")["epoch"] == 31
    assert advisor.frames == []
    assert advisor.of("epoch_prepared") == []


def test_a_manager_that_reigns_beside_it_is_no_rival(advisor: OneManager) -> None:
    lease = Lease(9, 0, Step.PREPARED, 0)
    advisor.hear(Frame(management_id(127, Command.LEASE), lease.encode()))
    advisor.start(fly=False)
    assert advisor.stops == []
    assert advisor.requests


def test_what_another_manager_does_otherwise_is_nobodys_fault(advisor: OneManager) -> None:
    advisor.start(fly=False)
    do_as_advised(advisor, 30)
    for pe in advisor.spec.pes:
        advisor.live(pe, PeState.ACTIVE, epoch=31, digest=5)
    advisor.hear(
        Frame(advisor.state_id("left"), StatePage1(PeState.ACTIVE, PeFlags(0), 31, 0, Reason.IMAGE, 0).encode())
    )
    assert advisor.of("pe_lost") == []
    advisor.report("left", LEFT_SERVO_FAILED)
    assert advisor.requests[-1].running is None
    assert advisor.frames == []
