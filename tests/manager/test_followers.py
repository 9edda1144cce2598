"""Readers of a manager's events: every event once, or a count of those that were dropped; nobody holds it up."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_manager import events
from heronry_manager.events.reading import events_in, read_event
from heronry_manager.shell.control_client import follow
from heronry_manager.shell.control_place import ControlError
from heronry_manager.shell.control_protocol import Follow, order_line, read_order
from heronry_manager.shell.control_socket import ControlSocket
from heronry_manager.shell.followers import LONGEST_QUEUE_BYTES, MOST_FOLLOWERS, Followers


def status() -> events.Status:
    return events.Status(7, status={}, plan=None, bus=events.Place("can0", "softbus", "can0.sock"), file="s.dg.yaml")


@pytest.fixture
def control(tmp_path: Path) -> Iterator[ControlSocket]:
    with ControlSocket(tmp_path / "manager.sock") as control:
        yield control


def joined(control: ControlSocket) -> socket.socket:
    """A reader that has begun to follow."""
    reader = follow(control.path)
    control.poll()  # the call
    assert control.poll() == []  # the order
    control.followers.pump(status)
    return reader


def lines(reader: socket.socket, until: type[events.Event]) -> list[events.Event]:
    found = []
    with reader.makefile("rb") as stream:
        for line in stream:
            found.append(read_event(line))
            if isinstance(found[-1], until):
                return found
    return found


def test_follow_is_an_order_like_any_other() -> None:
    assert read_order(order_line(Follow())) == Follow()


def test_a_reader_gets_a_status_and_then_every_event(control: ControlSocket) -> None:
    with joined(control) as reader:
        for number in range(3):
            control.followers.tell(events.PeAnswered(number, pe="nav"))
            control.followers.pump(status)
        control.followers.tell(events.Stopped(9, reason="done"))
        control.followers.pump(status)
        told = lines(reader, events.Stopped)
    assert [one.kind for one in told] == ["status", "pe_answered", "pe_answered", "pe_answered", "stopped"]
    assert control.followers.writers() == []


def test_a_reader_that_sleeps_is_told_how_much_it_missed_and_goes_on_from_a_status(control: ControlSocket) -> None:
    sent = 0
    with joined(control) as reader:
        big = events.Stopped(1, reason="x" * 4000)
        while sent < 1000:
            control.followers.tell(big)
            control.followers.pump(status)
            sent += 1
        assert control.followers.writers() != []
        found: list[events.Event] = []
        reader.settimeout(0.01)
        data = b""
        while not found or not isinstance(found[-1], events.Status) or len(found) == 1:
            control.followers.pump(status)
            try:
                data += reader.recv(1 << 20)
            except TimeoutError:
                continue
            found = list(events_in(data.rpartition(b"\n")[0].splitlines()))
    kinds = [one.kind for one in found]
    assert kinds[0] == "status"
    assert kinds[-2:] == ["lines_lost", "status"]
    lost = found[-2]
    assert isinstance(lost, events.LinesLost)
    assert len(kinds) - 3 + lost.lines == sent
    assert 4000 * (len(kinds) - 3) < LONGEST_QUEUE_BYTES + (1 << 20)


def test_ten_readers_that_never_read_hold_nobody_up_and_take_bounded_memory(control: ControlSocket) -> None:
    readers = [joined(control) for _ in range(10)]
    told = events.Stopped(1, reason="x" * 4000)
    for _ in range(600):
        control.followers.tell(told)
        control.followers.pump(status)
    waiting = [follower.waiting_bytes for follower in control.followers._of.values()]
    assert max(waiting) <= LONGEST_QUEUE_BYTES
    assert len(control.followers.writers()) == 10
    for reader in readers:
        reader.close()


def test_a_reader_that_hangs_up_is_forgotten(control: ControlSocket) -> None:
    reader = joined(control)
    reader.sendall(b"more words\n")
    control.poll()
    assert len(control.followers.readers()) == 1
    reader.close()
    control.poll()
    assert control.followers.readers() == []
    another = joined(control)
    another.close()
    control.followers.tell(events.Stopped(1, reason=""))
    control.followers.pump(status)
    control.followers.tell(events.Stopped(1, reason=""))
    control.followers.pump(status)
    assert control.followers.readers() == []


def test_a_reader_that_resets_the_line_is_forgotten() -> None:
    ours, theirs = socket.socketpair()
    followers = Followers()
    assert followers.take(ours)
    ours.setblocking(False)
    followers.pump(status)
    theirs.close()  # with bytes unread: the next read of the other end fails
    followers.heard(ours)
    assert followers.readers() == []


def test_a_reader_too_many_is_refused_in_words(control: ControlSocket) -> None:
    readers = [joined(control) for _ in range(MOST_FOLLOWERS)]
    with follow(control.path) as one_more:
        control.poll()
        control.poll()
        one_more.settimeout(5)
        assert b"too many readers" in one_more.recv(4096)
    control.close()
    assert [reader.recv(1 << 16)[-1:] for reader in readers] == [b"\n"] * MOST_FOLLOWERS
    for reader in readers:
        reader.close()


def test_nobody_to_follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ControlError, match="no manager listens on"):
        follow(tmp_path / "nobody.sock")
    with ControlSocket(tmp_path / "a.sock") as control:
        monkeypatch.setattr("heronry_manager.shell.control_client.user_beyond", lambda _: os.getuid() + 1)
        monkeypatch.setattr(os, "getuid", lambda: 4711)
        with pytest.raises(ControlError, match="another user's"):
            follow(control.path)
