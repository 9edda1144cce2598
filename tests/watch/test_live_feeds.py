"""A manager that is followed: its status, its events, its end and its return, without processes."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.events import Event, ManagerStarted, PhaseChanged, Place, Status, Stopped
from heronry_manager.shell.control_place import ControlError
from heronry_manager.shell.control_socket import ControlSocket
from heronry_manager.shell.followers import Followers
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec
from heronry_tools.watch import live_feeds
from heronry_tools.watch.live_feeds import FollowedManager
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Snapshot, Stranger, Transfer
from heronry_tools.watch.top.sources import LiveSource

SPEC, OTHER = load_spec("big_blue"), load_spec("elevator_and_chute")
PATIENCE_S = 30.0


def status(t_ns: int = 5, spec_digest: str = SPEC.digest) -> Status:
    """What a manager of big_blue says that listens, on a bus that cannot be opened here."""
    core = ManagerCore(SPEC, 126, NOTHING, 5)
    told = {**core.status(), "spec_digest": spec_digest}
    place = Place("can0", "softbus", "/no/such.sock")
    return Status(t_ns, told, plan=None, bus=place, file=str(shipped_spec_path("big_blue")))


def status_of_what_comes() -> Status:
    """What a manager says while a table, code and nodes are coming."""
    offer = {"version": "1", "python": "3.11", "machine": "arm64", "cores": 4, "ram_kib": 2048, "disk_kib": 4096}
    coming = {
        "tables": {"flight": "its table: 512 of 1024 bytes", "nav": "its turn comes"},
        "code": {"comms": "no bundle"},
        "transfers": [{"pe": "flight", "bytes": 512, "of": 1024}],
        "unknown_nodes": [
            {"node": 101, "says": "waits", "for_ns": 1, "offer": offer | {"images": ["a", "b"]}},
            {"node": 102, "says": "runs", "for_ns": 1, "offer": {"cores": -1}},
            {"node": 103, "says": "runs", "for_ns": 1},
        ],
    }
    return replace(status(), status={**status().status, **coming})


def test_a_status_gives_the_snapshot_what_is_coming() -> None:
    event = status_of_what_comes()
    reducer = Reducer(SPEC)
    view = reducer.after(reducer.start(), event).snapshot
    assert view.transfers == (
        Transfer("flight", "table", "its table: 512 of 1024 bytes", 50),
        Transfer("nav", "table", "its turn comes"),
        Transfer("comms", "code", "no bundle"),
    )
    has = "arm64, 4 cores, 2 MiB of memory, 4 MiB of disk, Python 3.11, heronry 1"
    assert view.strangers == (
        Stranger(101, "waits", has, ("a", "b"), "heronry adopt big_blue 101"),
        Stranger(102, "runs"),
        Stranger(103, "runs"),
    )


@contextmanager
def manager_on(path: Path, first: Event | Callable[[], Event]) -> Iterator[ControlSocket]:
    """A manager's socket, served by a thread; `first`: its first line to each follower."""
    over = threading.Event()

    def serve(control: ControlSocket) -> None:
        while not over.wait(0.005):
            control.poll()
            control.followers.pump(lambda: first if isinstance(first, Event) else first())

    with ControlSocket(path) as control:
        server = Thread(target=serve, args=(control,))
        server.start()
        try:
            yield control
        finally:
            over.set()
            server.join()


def polled(feed: FollowedManager, until: Callable[[list[Any]], object]) -> list[Any]:
    found: list[Any] = []
    until_s = time.monotonic() + PATIENCE_S
    while not until(found) and time.monotonic() < until_s:
        found += feed.poll()
        time.sleep(0.005)
    assert until(found), found
    return found


def test_a_manager_is_followed_to_its_end_and_from_its_return_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_feeds, "_AGAIN_NS", 0)
    path = tmp_path / "big_blue.sock"
    with manager_on(path, status()) as control:
        feed = FollowedManager(path)
        assert (feed.spec.digest, feed.spec_file) == (SPEC.digest, shipped_spec_path("big_blue"))
        assert len(feed.readers()) == 1
        control.followers.tell(PhaseChanged(9, phase="landing", before="ascent", by="operator"))
        events = polled(feed, lambda found: len(found) == 2)
        view = Reducer(SPEC).all(events).snapshot
        assert (view.phase, view.manager.state, view.manager.node) == ("landing", "listening", 126)
    polled(feed, lambda _: feed.trouble is not None)
    assert "has gone" in str(feed.trouble)
    assert feed.readers() == []
    with manager_on(path, status(t_ns=99)):
        events = polled(feed, lambda found: found)
        assert (events[0].kind, events[0].t_ns, feed.trouble) == ("status", 99, None)
    feed.close()


def another_status(t_ns: int) -> Status:
    """What the manager says that flies by elevator_and_chute now, whose file has gone; it keeps a copy."""
    core = ManagerCore(OTHER, 126, NOTHING, 5)
    told = {**core.status(), "files": {"flies": str(shipped_spec_path("elevator_and_chute"))}}
    return Status(t_ns, told, plan=None, bus=Place("can0", "softbus", "/no/such.sock"), file="/gone.dg.yaml")


def another_started(t_ns: int) -> ManagerStarted:
    """What the core of another spec tells first."""
    return ManagerStarted(
        t_ns,
        spec=OTHER.name,
        spec_digest=OTHER.digest,
        node=126,
        term=3,
        bus="can0",
        phase=None,
        advises=False,
        key=None,
    )


def test_a_view_goes_on_when_the_aircraft_changes_to_another_spec(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_feeds, "_AGAIN_NS", 0)
    path, now = tmp_path / "big_blue.sock", [status()]
    with manager_on(path, lambda: now[-1]) as control:
        feed = FollowedManager(path)
        view = LiveSource(feed)

        def shown(holds: Callable[[Snapshot], object]) -> Snapshot:
            until_s = time.monotonic() + PATIENCE_S
            while not holds(view.snapshot()):
                assert time.monotonic() < until_s, view.snapshot()
                view.look()
                time.sleep(0.005)
            return view.snapshot()

        control.followers.tell(PhaseChanged(9, phase="landing", before="ascent", by="operator"))
        shown(lambda view: view.phase == "landing")
        now.append(another_status(20))
        control.followers.tell(another_started(19))
        last = shown(lambda view: view.t_ns == 20)
        assert (last.spec, last.spec_digest, last.pes.keys()) == (OTHER.name, OTHER.digest, OTHER.pes.keys())
        assert any(one.event == "phase_changed" for one in last.told)
        assert (feed.spec_file, feed.trouble) == (shipped_spec_path("elevator_and_chute"), None)
    shown(lambda _: feed.trouble)
    with manager_on(path, status(t_ns=99)):  # it is started again, with the first spec
        assert shown(lambda view: view.t_ns == 99).spec == "big_blue"
    feed.close()


def test_a_manager_that_cannot_be_followed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "big_blue.sock"
    with (
        manager_on(path, status(spec_digest="ab" * 32)),
        pytest.raises(UserError, match="has changed since the manager was started"),
    ):
        FollowedManager(path)
    with manager_on(path, Stopped(5, "no")), pytest.raises(ControlError, match="cannot be followed"):
        FollowedManager(path)
    with manager_on(path, status()):
        monkeypatch.setattr(Followers, "take", lambda *_: False)
        with pytest.raises(ControlError, match="too many readers"):
            FollowedManager(path)
    monkeypatch.setattr(live_feeds, "_FIRST_LINE_S", 0.05)
    with ControlSocket(path), pytest.raises(ControlError, match="gives no status"):
        FollowedManager(path)
