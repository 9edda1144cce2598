"""How a manager begins and ends its mastership, checked by the frames that it sends."""

import pytest

from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import AliveLeft
from heronry_wire.frame import Frame
from heronry_wire.management import Alive, ElementKind, Emergency, FaultCode, Lease, Prepare, Step
from heronry_wire.node_services import Service, encode_service, request, service_id
from heronry_wire.protocol_times import START_UP_WINDOW_NS
from heronry_wire.state_frames import PeState
from lab.peers import command_frame
from manager.one_manager import BEAT_NS, MS, OneManager

FAULT = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 7)


def lease(term: int, node: int) -> Frame:
    return command_frame(Lease(term, 0, Step.PREPARED, 0), node)


def test_the_lease_of_a_lost_pe_runs_out_from_an_alive_of_this_term_on_and_from_no_other_frame() -> None:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, manager.node, manager.memory, manager.now_ns, tells_departures=True)
    manager.start(fly=False)
    manager.die("left")
    manager.pass_time(100 * MS)
    left = Alive(manager.core.term, 0, frozenset()).encode()
    for data, waits in ((b"", True), (Alive(99, 0, frozenset()).encode(), True), (left, False), (left, False)):
        assert manager.give(AliveLeft(Frame(manager.core.alive_id, data))) == []
        assert manager.core._known.exclusion.waits is waits, data


def test_while_it_listens_a_fault_is_not_acknowledged_and_a_silent_pe_gets_no_ping() -> None:
    manager = OneManager()
    manager.live("left")
    manager.report("left", FAULT)
    manager.die("left")
    manager.pass_time(90 * MS)
    assert manager.commands == []


def test_a_retired_manager_sends_nothing_whatever_happens() -> None:
    manager = OneManager()
    manager.start()
    manager.hear(lease(term=2, node=127))
    manager.pass_time(BEAT_NS)
    manager.hear(lease(term=2, node=127))
    assert len(manager.stops) == 1
    said = len(manager.commands)
    manager.reboot("left")
    manager.report("right", FAULT)
    assert manager.core.next_deadline_ns() is None
    assert len(manager.commands) == said


def test_a_manager_that_hears_its_double_says_what_is_wrong() -> None:
    manager = OneManager()
    manager.start()
    manager.hear(lease(term=1, node=126))
    manager.pass_time(BEAT_NS)
    manager.hear(lease(term=1, node=126))
    assert manager.stops[0].startswith("another manager 126 is active on can0, in the same term")


def test_a_manager_that_flies_alone_is_not_ended_by_single_frames_of_another() -> None:
    manager = OneManager()
    manager.start()
    for term, wait_ns in ((2, BEAT_NS), (3, BEAT_NS), (4, 0), (4, BEAT_NS // 4), (4, 0), (5, 6 * BEAT_NS), (5, 0)):
        manager.hear(lease(term, node=127))
        manager.pass_time(wait_ns)
    assert manager.stops == []
    manager.pass_time(BEAT_NS)
    manager.hear(lease(5, node=127))
    assert "higher term 5" in manager.stops[0]


@pytest.mark.parametrize(("own_losses", "remembered"), [(0, {}), (1, {}), (2, {"left": 2})])
def test_losses_counted_while_the_managers_receiver_had_failed_are_not_remembered(
    own_losses: int, remembered: dict[str, int]
) -> None:
    manager = OneManager()
    manager.start()
    for _ in range(own_losses):
        page = manager.running["left"]
        manager.die("left")
        manager.pass_time(200 * MS)
        manager.running["left"] = page
        manager.pass_time(1000 * MS)
        manager.answer()
    assert manager.memory.quarantined == {}
    manager.running.clear()
    manager.pass_time(200 * MS)
    assert manager.last(events.HearsNobody).term == 1
    assert manager.memory.quarantined == remembered


def test_a_manager_that_heard_no_pe_may_find_that_another_one_is_active() -> None:
    manager = OneManager()
    manager.start()
    for pe in list(manager.running):
        manager.die(pe)
    manager.pass_time(100 * MS)
    manager.hear(lease(term=2, node=127))
    assert "manager 127 is already active" in manager.stops[0]


def test_a_manager_that_never_heard_a_pe_goes_on_sending() -> None:
    manager = OneManager()
    manager.pass_time(START_UP_WINDOW_NS + 1_000 * MS)
    assert manager.of(events.HearsNobody) == []
    assert manager.said(Lease)[-1].term == 1


def test_a_pe_that_dies_while_others_are_awaited_is_lost_and_no_plan_is_requested_yet() -> None:
    manager = OneManager()
    for pe in ("left", "middle"):
        manager.live(pe)
    manager.pass_time(110 * MS)
    manager.die("middle")
    manager.pass_time(200 * MS)
    assert manager.last(events.PeLost).pe == "middle"
    assert manager.requests == []


def test_an_epoch_is_newer_than_any_that_a_pe_runs() -> None:
    manager = OneManager()
    manager.live("left", PeState.ACTIVE, epoch=65_535, digest=5)
    manager.live("middle")
    manager.live("right")
    manager.pass_time(110 * MS)
    manager.answer()
    assert manager.said(Prepare)[-1].epoch == 1


def test_it_identifies_itself_while_it_still_listens() -> None:
    manager = OneManager()
    manager.hear(encode_service(request(Service.IDS, node_id=126)))
    assert manager.core.next_deadline_ns() == manager.now_ns
    manager.pass_time(MS)
    assert [frame.can_id for frame in manager.frames] == [service_id(0, is_answer=True)]
