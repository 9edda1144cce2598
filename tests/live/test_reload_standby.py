"""Processes on a software bus change to another spec; the manager is killed, and the standby goes on with that spec."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.events import Adopted, PeJoined, Reconfigured, StandingBy, TakenOver
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import standby_of
from heronry_tools.cli import main
from heronry_tools.watch.live_feeds import FollowedManager
from heronry_tools.watch.top.sources import LiveSource
from live.node_processes import PATIENCE_S, Nodes, nodes_on_a_bus
from live.test_reload import NEWER, TEXT
from live.test_tables_by_themselves import NODES
from live.told_events import next_event

pytestmark = [pytest.mark.live, pytest.mark.soak]


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[Nodes]:
    with nodes_on_a_bus(tmp_path, Nodes) as nodes:
        yield nodes


def until(holds: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.1)


def test_a_standby_follows_a_reload_and_takes_over_with_the_new_spec(
    nodes: Nodes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, socket, other = tmp_path / "uav.dg.yaml", nodes.socket, standby_of(nodes.socket)
    file.write_text(TEXT)
    for pe, node in NODES.items():
        nodes.agent(pe, "--simulated", "--node", str(node), "--table", str(tmp_path / f"{pe}.table"))
    manager = nodes.manager(str(file), "--standby", "--node", "126")
    process = nodes.running[-1]
    waiting = set(NODES)
    while waiting:
        waiting.discard(next_event(manager, PeJoined).pe)
    next_event(manager, Reconfigured)
    standby = nodes.manager(str(file), "--standby", "--socket", str(other))
    next_event(standby, StandingBy, node=126)

    def flies_by(place: Path) -> str:
        return str((call(place, AskStatus()).status or {})["spec_digest"])

    before = flies_by(socket)
    with closing(LiveSource(FollowedManager(socket))) as view:
        file.write_text(NEWER)
        end_s = time.monotonic() + PATIENCE_S
        while main(["reload", str(file), "--yes", "--socket", str(socket)]):
            assert time.monotonic() < end_s, capsys.readouterr().err  # a busy computer may lose a PE for a moment
            time.sleep(0.5)
        after = flies_by(socket)
        assert after != before
        until(lambda: flies_by(other) == after)

        def is_shown() -> bool:
            view.look()
            return view.snapshot().spec_digest == after and view.snapshot().stage == "running"

        until(is_shown)
        assert "spare_estimator" in view.snapshot().modules
    assert next(iter((tmp_path / "manager-127.other").iterdir())).read_text() == NEWER
    process.kill()
    assert next_event(standby, TakenOver).silent_ns is not None
    next_event(standby, Adopted)
    until(lambda: (call(other, AskStatus()).status or {})["stage"] == "done")
    status = call(other, AskStatus()).status or {}
    assert (status["spec_digest"], status["manager"]["state"]) == (after, "active")
    assert {pe["state"] for pe in status["pes"].values()} == {"up"}
    assert all('"spare_estimator"' in (tmp_path / f"{pe}.table").read_text() for pe in NODES)
