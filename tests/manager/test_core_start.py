"""How a manager begins and ends its reign, told by what it says on the bus."""

import pytest

from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import AliveLeft
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id, state_id
from heronry_wire.management import Alive, ElementKind, Emergency, FaultCode, Lease, Ping, Prepare, Step
from heronry_wire.node_services import Service, encode_service, request, service_id
from heronry_wire.protocol_times import START_UP_WINDOW_NS
from heronry_wire.sansio import Tick
from heronry_wire.state_frames import PeFlags, PeState
from manager.one_manager import BEAT_NS, MS, OneManager

FAULT = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 7)


def lease(term: int, node: int) -> Frame:
    return Frame(management_id(node, Command.LEASE), Lease(term, 0, Step.PREPARED, 0).encode())


def test_it_listens_for_t_lease_before_it_says_anything() -> None:
    manager = OneManager()
    manager.pass_time(99 * MS)
    manager.give(Tick())  # a timer that rings early changes nothing
    assert manager.commands == []
    manager.pass_time(2 * MS)
    assert [type(said) for said in manager.commands] == [Lease, Alive]


def test_an_alive_that_has_left_asks_for_nothing_of_whatever_term_it_is() -> None:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, manager.node, manager.memory, manager.now_ns, tells_departures=True)
    manager.pass_time(101 * MS)
    left = Alive(manager.core.term, 0, frozenset()).encode()
    for data in (b"", Alive(99, 0, frozenset()).encode(), left, left):
        assert manager.give(AliveLeft(Frame(manager.core.alive_id, data))) == []


def test_while_it_listens_a_fault_is_not_acknowledged_and_a_silent_pe_is_not_asked() -> None:
    manager = OneManager()
    manager.live("left")
    manager.report("left", FAULT)
    manager.die("left")
    manager.pass_time(90 * MS)
    assert manager.commands == []


def test_a_lease_heard_while_it_listens_is_another_manager_and_it_does_not_start() -> None:
    manager = OneManager()
    manager.hear(lease(term=1, node=127))
    (reason,) = manager.stops
    assert "manager 127 already reigns on can0" in reason
    assert manager.last("second_manager")["node"] == 127
    assert manager.core.next_deadline_ns() is None


def test_a_retired_manager_says_nothing_whatever_happens() -> None:
    manager = OneManager()
    manager.start()
    manager.hear(lease(term=2, node=127))
    assert len(manager.stops) == 1
    said = len(manager.commands)
    manager.reboot("left")
    manager.report("right", FAULT)
    assert manager.core.next_deadline_ns() is None
    assert len(manager.commands) == said


@pytest.mark.parametrize(
    ("own", "other", "term", "stops"),
    [(126, 127, 2, True), (127, 126, 3, True), (127, 126, 1, False), (126, 126, 1, True), (126, 126, 3, True)],
)
def test_of_two_managers_the_one_with_the_higher_term_goes_on_and_of_two_of_one_number_who_is_heard_first(
    own: int, other: int, term: int, stops: bool
) -> None:
    manager = OneManager(node=own)
    manager.start()
    manager.hear(lease(term=term, node=other))
    assert bool(manager.stops) is stops


def test_who_hears_its_double_says_what_is_wrong() -> None:
    manager = OneManager()
    manager.start()
    manager.hear(lease(term=1, node=126))
    assert manager.stops[0].startswith("another manager 126 reigns on can0, in the same term")


def test_who_hears_nobody_any_more_says_nothing_until_somebody_is_heard_and_begins_a_new_term() -> None:
    manager = OneManager()
    manager.start()
    runs = dict(manager.running)
    for pe in runs:
        manager.die(pe)
    manager.pass_time(100 * MS)
    assert manager.last("hears_nobody")["term"] == 1
    said = len(manager.frames)
    manager.pass_time(2_000 * MS)
    assert len(manager.frames) == said
    assert manager.core.next_deadline_ns() is None
    for pe, page in runs.items():
        manager.running[pe] = page
        manager.beat(pe)
    manager.pass_time(90 * MS)
    assert len(manager.frames) == said
    manager.pass_time(40 * MS)
    assert manager.said(Lease)[-1].term == 3
    assert manager.last("adopted")["epoch"] == 1
    assert len(manager.of("reconfigured")) == 1


def test_who_is_refused_by_most_pes_begins_a_new_term_and_waits_longer_each_time() -> None:
    manager = OneManager()
    manager.start()
    for pe, flags in (("left", PeFlags(0)), ("middle", PeFlags.HEARS_LEASE), ("right", PeFlags(0))):
        manager.flags = flags
        page = manager.running[pe]
        manager.live(pe, page.state, epoch=page.epoch, digest=page.digest)
    manager.pass_time(60 * MS)
    assert manager.of("refused") == []
    manager.pass_time(8_000 * MS)
    terms = [told["term"] for told in manager.of("refused")]
    assert terms == [1, 3, 261, 263, 265, 267]  # after 0.1, 0.2, 0.4, 0.8, 1.6 and 3.2 s
    assert manager.said(Lease)[-1].term == 269
    manager.flags = PeFlags.HEARS_LEASE
    for pe, page in list(manager.running.items()):
        manager.live(pe, page.state, epoch=page.epoch, digest=page.digest)
    manager.pass_time(10_000 * MS)
    assert manager.said(Lease)[-1].term == 269


@pytest.mark.parametrize(("own_losses", "remembered"), [(0, {}), (1, {}), (2, {"left": 2})])
def test_what_a_deaf_manager_has_counted_is_not_remembered_against_anybody(
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
    assert manager.last("hears_nobody")["term"] == 1
    assert manager.memory.quarantined == remembered


def test_who_hears_nobody_may_find_that_another_one_reigns() -> None:
    manager = OneManager()
    manager.start()
    for pe in list(manager.running):
        manager.die(pe)
    manager.pass_time(100 * MS)
    manager.hear(lease(term=2, node=127))
    assert "manager 127 already reigns" in manager.stops[0]


def test_where_nobody_was_ever_heard_it_goes_on_speaking() -> None:
    manager = OneManager()
    manager.pass_time(START_UP_WINDOW_NS + 1_000 * MS)
    assert manager.of("hears_nobody") == []
    assert manager.said(Lease)[-1].term == 1


def test_the_lease_of_a_lower_term_changes_nothing() -> None:
    manager = OneManager(term=3)
    manager.start()
    manager.hear(lease(term=2, node=127))
    assert manager.stops == []


def test_who_is_not_heard_in_the_start_up_window_is_planned_without() -> None:
    manager = OneManager()
    for pe in ("left", "middle"):
        manager.live(pe)
    manager.pass_time(START_UP_WINDOW_NS - MS)
    assert manager.requests == []
    manager.pass_time(2 * MS)
    assert manager.last("pe_absent")["pe"] == "right"
    assert manager.requests[-1].now.down == {"pe:right"}


def test_who_dies_while_others_are_awaited_is_lost_and_no_plan_is_asked_for_yet() -> None:
    manager = OneManager()
    for pe in ("left", "middle"):
        manager.live(pe)
    manager.pass_time(110 * MS)
    manager.die("middle")
    manager.pass_time(200 * MS)
    assert manager.last("pe_lost")["pe"] == "middle"
    assert manager.requests == []


def test_every_period_it_repeats_its_lease_and_whom_it_counts_on() -> None:
    manager = OneManager()
    manager.start(fly=False)
    manager.commands.clear()
    manager.pass_time(10 * BEAT_NS)
    assert len(manager.said(Lease)) == 10
    assert {alive.nodes for alive in manager.said(Alive)} == {frozenset({92, 93, 94})}
    assert len({alive.sequence for alive in manager.said(Alive)}) == 10


def test_who_misses_a_beat_is_asked_until_it_answers_or_is_lost() -> None:
    manager = OneManager()
    manager.start()
    manager.die("right")
    manager.pass_time(50 * MS)
    assert manager.last("pe_suspected")["pe"] == "right"
    assert {ping.node for ping in manager.said(Ping)} == {94}
    assert len(manager.said(Ping)) >= 2


def test_epochs_of_a_later_reign_have_numbers_of_their_own() -> None:
    manager = OneManager(term=3)
    manager.start(fly=False)
    manager.answer()
    assert manager.prepared()[0] == 33


def test_an_epoch_is_newer_than_any_that_a_pe_runs() -> None:
    manager = OneManager()
    manager.live("left", PeState.ACTIVE, epoch=65_535, digest=5)
    manager.live("middle")
    manager.live("right")
    manager.pass_time(110 * MS)
    manager.answer()
    assert manager.said(Prepare)[-1].epoch == 1


def test_it_answers_who_it_is() -> None:
    manager = OneManager()
    manager.start()
    asked = encode_service(request(Service.IDS, node_id=126))
    assert manager.core.hears(asked.can_id)
    manager.frames.clear()
    manager.hear(asked)
    manager.pass_time(MS)
    assert service_id(0, is_answer=True) in {frame.can_id for frame in manager.frames}


def test_it_answers_who_it_is_while_it_still_listens() -> None:
    manager = OneManager()
    manager.hear(encode_service(request(Service.IDS, node_id=126)))
    assert manager.core.next_deadline_ns() == manager.now_ns
    manager.pass_time(MS)
    assert [frame.can_id for frame in manager.frames] == [service_id(0, is_answer=True)]


@pytest.mark.parametrize(
    "frame",
    [
        Frame(state_id(92), b""),
        Frame(state_id(92), b"\xff" * 8),
        Frame(220, b"\x01"),
        Frame(management_id(127, Command.LEASE), b"\x00"),
        Frame(state_id(92), bytes(8), extended=True),
        Frame(0x123, bytes(8)),
    ],
)
def test_frames_that_mean_nothing_change_nothing(frame: Frame) -> None:
    manager = OneManager()
    manager.start()
    events = len(manager.events)
    manager.hear(frame)
    assert len(manager.events) == events
