"""Nodes that the spec does not have are told, and change nothing; PEs that wait for a table are in the status."""

import json
from itertools import pairwise

import pytest

from heronry_agent.shell.offer import offer
from heronry_manager import events
from heronry_manager.core.provisioning.table_bringing import FORGOTTEN_NS as FORGOTTEN_TABLE_NS
from heronry_manager.core.provisioning.unknown_nodes import FORGOTTEN_NS, IDLE, RUNS, WAITS
from heronry_tools.reports.status import report
from heronry_wire.canopen_objects import OFFER
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.peers import PlayedObjects
from manager.one_manager import MS, OneManager
from manager.test_operator import status

STRANGER = 101


def says(manager: OneManager) -> list[tuple[int, str]]:
    return [(one["node"], one["says"]) for one in status(manager)["unknown_nodes"]]


def told(manager: OneManager) -> list[tuple[int, str]]:
    return [(one.node, one.says) for one in manager.of(events.UnknownNode)]


def state(state: PeState, epoch: int = 0) -> Frame:
    return Frame(state_id(STRANGER), StatePage0(state, PeFlags(0), 1, epoch, 0, 0).encode())


def test_a_node_that_is_not_in_the_spec_is_told_once_with_what_it_does() -> None:
    manager = OneManager(brings_tables=True)
    manager.start()
    assert manager.core.hears(heartbeat_id(STRANGER))
    assert manager.core.hears(state_id(STRANGER))
    for _ in range(3):
        manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
        manager.pass_time(1_000 * MS)
    assert says(manager) == [(STRANGER, WAITS)]
    manager.hear(Frame(state_id(STRANGER), b""))
    manager.hear(state(PeState.UNCONFIGURED))
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    assert says(manager) == [(STRANGER, IDLE)]
    manager.hear(state(PeState.ACTIVE, 7))
    assert says(manager) == [(STRANGER, RUNS)]
    assert told(manager) == [(STRANGER, WAITS)]
    for _ in range(8):
        manager.pass_time(1_000 * MS)
        manager.hear(state(PeState.ACTIVE, 7))
    assert told(manager) == [(STRANGER, WAITS), (STRANGER, RUNS)]
    assert f"! node {STRANGER} is not in the spec: it {RUNS}" in list(report(status(manager)))
    assert not [one for one in manager.frames if one.can_id == sdo_request_id(STRANGER)]
    manager.pass_time(FORGOTTEN_NS + 1)
    assert says(manager) == []
    manager.hear(state(PeState.ACTIVE, 7))
    assert told(manager)[2:] == [(STRANGER, RUNS)]


OFFER_TEXT = offer()


def asking() -> OneManager:
    """A manager that reads objects, and has heard a node that waits."""
    manager = OneManager(brings_tables=True, reads_objects=True)
    manager.start()
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    return manager


class Stranger(PlayedObjects):
    """A node that answers each request once."""

    def __init__(self) -> None:
        super().__init__()
        self.seen, self.at_ns = 0, list[int]()  # frames that were looked at; when each request came

    def talk(self, manager: OneManager) -> None:
        """Answer for two seconds, and then beat."""
        end_ns = manager.now_ns + 2_000 * MS
        while manager.now_ns < end_ns:
            new, self.seen = manager.frames[self.seen :], len(manager.frames)
            for frame in new:
                if frame.can_id == sdo_request_id(STRANGER):
                    manager.hear(Frame(sdo_response_id(STRANGER), self.answer(STRANGER, frame.data)))
                    self.at_ns.append(manager.now_ns)
            manager.pass_time(2 * MS)
        manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))


def test_a_node_that_waits_is_asked_slowly_what_it_offers_and_this_is_told() -> None:
    manager, node = asking(), Stranger()
    node.values[STRANGER, OFFER, 0] = OFFER_TEXT.encode()
    assert status(manager)["unknown_nodes"][0]["offer"] is None
    node.talk(manager)
    (told,) = status(manager)["unknown_nodes"]
    assert told["offer"] == json.loads(OFFER_TEXT)
    assert len(node.at_ns) >= len(OFFER_TEXT) // 7
    assert all(after - before >= 40 * 135_000 - 2 * MS for before, after in pairwise(node.at_ns[1:]))
    lines = list(report(status(manager)))
    assert any("is not in the spec: it waits for a table (" in line and "Python" in line for line in lines)
    assert f"  heronry adopt two_tails {STRANGER}" in lines
    for _ in range(62):
        manager.pass_time(1_000 * MS)
        manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    node.talk(manager)
    assert node.asked == [(STRANGER, OFFER, 0)]
    manager.hear(state(PeState.ACTIVE, 7))
    assert status(manager)["unknown_nodes"][0]["offer"] is None


def test_a_node_that_was_not_heard_for_long_may_be_another_one() -> None:
    manager, node = asking(), Stranger()
    node.values[STRANGER, OFFER, 0] = OFFER_TEXT.encode()
    node.talk(manager)
    manager.pass_time(FORGOTTEN_NS + 1)
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    assert status(manager)["unknown_nodes"][0]["offer"] is None


@pytest.mark.parametrize("answer", [b"", b"no offer", b"{}", None])
def test_a_node_that_offers_nothing_is_asked_again_after_a_minute(answer: bytes | None) -> None:
    manager, node = asking(), Stranger()
    if answer is not None:
        node.values[STRANGER, OFFER, 0] = answer
    node.talk(manager)
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    node.talk(manager)
    assert len(node.asked) == 1
    assert status(manager)["unknown_nodes"][0]["offer"] is None
    manager.pass_time(60_000 * MS)
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    node.talk(manager)
    assert len(node.asked) == 2


def test_another_client_asks_a_node_first_and_a_manager_that_is_not_active_asks_none() -> None:
    manager = asking()
    asked = len([one for one in manager.frames if one.can_id == sdo_request_id(STRANGER)])
    assert asked == 1
    manager.hear(Frame(sdo_request_id(STRANGER), bytes(8)))
    manager.pass_time(900 * MS)
    assert len([one for one in manager.frames if one.can_id == sdo_request_id(STRANGER)]) == 1
    manager.pass_time(200 * MS)
    assert len([one for one in manager.frames if one.can_id == sdo_request_id(STRANGER)]) == 2
    manager.running.clear()
    manager.pass_time(3_000 * MS)
    assert not manager.core.is_active
    before = len(manager.frames)
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x7f"))
    manager.pass_time(1_000 * MS)
    assert not [one for one in manager.frames[before:] if one.can_id == sdo_request_id(STRANGER)]


def test_a_device_of_another_system_does_not_wait_for_a_table() -> None:
    manager = OneManager(brings_tables=True)
    manager.start()
    for byte in (b"\x05", b"\x04", b"", b"\x7f\x00"):
        manager.hear(Frame(heartbeat_id(STRANGER), byte))
        assert says(manager) == [(STRANGER, RUNS)]
    manager.hear(Frame(heartbeat_id(STRANGER), b"\x00"))
    assert says(manager) == [(STRANGER, WAITS)]


def test_many_forged_frames_make_one_event_in_ten_seconds() -> None:
    manager = OneManager(brings_tables=True)
    manager.start()
    for _ in range(100):
        for one in (PeState.UNCONFIGURED, PeState.ACTIVE):
            manager.hear(state(one))
        manager.pass_time(100 * MS)
    assert len(told(manager)) == 1
    manager.pass_time(100 * MS)
    manager.hear(state(PeState.ACTIVE))
    assert len(told(manager)) == 2


def test_a_pe_that_waited_and_is_switched_off_is_forgotten() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die("left")
    manager.pass_time(1_500 * MS)
    manager.hear(Frame(heartbeat_id(92), b"\x7f"))
    manager.pass_time(1_100 * MS)
    assert status(manager)["tables"] == {"left": "it did not answer"}
    manager.pass_time(FORGOTTEN_TABLE_NS)
    assert status(manager)["tables"] == {}


def test_a_manager_that_is_not_active_any_more_tells_of_no_pe_that_waits() -> None:
    manager = OneManager(brings_tables=True, node=127)
    manager.start(fly=False)
    manager.die("left")
    manager.pass_time(1_500 * MS)
    manager.hear(Frame(heartbeat_id(92), b"\x7f"))
    manager.pass_time(1_100 * MS)
    assert status(manager)["tables"]
    manager.running.clear()
    for _ in range(50):  # it hears nobody, and falls silent
        manager.pass_time(20 * MS)
        manager.hear(Frame(heartbeat_id(92), b"\x7f"))
        if not manager.core.is_active:
            break
    assert not manager.core.is_active
    assert manager.core.status()["tables"] == {}


def test_a_pe_that_waits_for_its_table_is_in_the_status() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    for pe in ("left", "right"):
        manager.die(pe)
    manager.pass_time(1_500 * MS)
    assert status(manager)["tables"] == {}
    for node in (92, 94):
        manager.hear(Frame(heartbeat_id(node), b"\x7f"))
    assert status(manager)["tables"] == {"left": "its table: 0 of 741 bytes", "right": "its turn comes"}
    manager.pass_time(1_100 * MS)
    assert status(manager)["tables"] == {"left": "it did not answer", "right": "its table: 0 of 696 bytes"}
    assert "! left waits for its table: it did not answer" in list(report(status(manager)))
    manager.pass_time(10_000 * MS)  # neither is heard again
    assert status(manager)["tables"] == {}
