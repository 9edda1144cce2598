"""A fleet with a key, each node a process of its own: it is started, unlocked, given a table, and loses a PE."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_manager.events import (
    Adopted,
    ManagerStarted,
    PeJoined,
    PeLost,
    Reconfigured,
    Summary,
    TableBrought,
    TakenOver,
)
from heronry_manager.events.reading import events_in
from heronry_tools.cli import main
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.key_file import make_key
from lab.slow_spec import slow_spec
from live.node_processes import Nodes, ended
from live.told_events import next_event

pytestmark = pytest.mark.live
PATIENCE_S = 120
HERONRY = [sys.executable, "-m", "heronry_tools"]
PES = ("sensor_pe", "control_pe", "tail_pe")
TAIL_NODE = 94
SHOW = ("--kill", "manager@1", "--kill", "pe:sensor_pe@5", "--restore", "pe:sensor_pe@7", "--for", "13")


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    """An aircraft with long heartbeats, so that a busy machine loses no PE."""
    return slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=200)


@pytest.fixture
def key(tmp_path: Path) -> Path:
    file = tmp_path / "fleet.key"
    make_key(file)
    return file


def test_the_demo_flies_with_a_key_loses_its_manager_and_takes_a_killed_pe_back(spec: Path, key: Path) -> None:
    done = subprocess.run(
        [*HERONRY, "demo", str(spec), "--key", str(key), "--contingencies", "none", "--json", *SHOW],
        capture_output=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()
    events = list(events_in(done.stdout.splitlines()))
    (started,) = (one for one in events if isinstance(one, ManagerStarted))
    assert started.key == make_fingerprint(key)
    (taken,) = (one for one in events if isinstance(one, TakenOver))
    assert (taken.before, taken.term) == (1, 2)
    assert [one.kind for one in events if isinstance(one, Adopted)] == ["adopted"]
    assert [one.pe for one in events if isinstance(one, PeLost)] == ["sensor_pe"]
    assert "sensor_pe" in [one.pe for one in events if isinstance(one, PeJoined)][len(PES) :]
    (summary,) = (one for one in events if isinstance(one, Summary))
    assert summary.unserved == ()


def make_fingerprint(key: Path) -> str:
    told = subprocess.run([*HERONRY, "key", "--check", str(key)], capture_output=True, text=True, check=True)
    return told.stdout.split()[-1]


class Fleet(Nodes):
    """The processes of one flight with a key."""

    def __init__(self, bus: Path, folder: Path, spec: Path, key: Path) -> None:
        super().__init__(bus, folder, "--key", str(key))
        self.spec, self.key = str(spec), str(key)

    def send_table(self, *more: str) -> int:
        return main(["send-table", self.spec, "tail_pe", *self.bus, *more])


@pytest.fixture
def fleet(tmp_path: Path, spec: Path, key: Path) -> Iterator[Fleet]:
    with start_hub(tmp_path / "can0.sock", 1_000_000) as hub, ended(Fleet(hub.path, tmp_path, spec, key)) as fleet:
        yield fleet


def test_a_pe_with_a_key_takes_its_table_only_with_the_key_and_an_unlock(
    fleet: Fleet, capsys: pytest.CaptureFixture[str]
) -> None:
    manager = fleet.manager(fleet.spec)
    for pe in PES[:2]:
        table = str(fleet.folder / f"{pe}.table")
        assert main(["table", fleet.spec, pe, "-o", table]) == 0
        fleet.agent(pe, "--simulated", "--table", table)
    fleet.agent("tail_pe", "--simulated", "--node", str(TAIL_NODE))
    next_event(manager, TableBrought, pe="tail_pe")  # unlocked and sealed by the manager, of its own accord
    next_event(manager, PeJoined, pe="tail_pe")
    next_event(manager, Reconfigured)
    capsys.readouterr()
    assert fleet.send_table() == 2
    assert "did not take the table (Code 0x08000022" in capsys.readouterr().err
    assert fleet.send_table("--key", fleet.key, "--socket", str(fleet.folder / "nobody.sock")) == 2
    assert "no manager listens on" in capsys.readouterr().err
    # It flies, and keeps the table beside the one by which it flies.
    assert fleet.send_table("--key", fleet.key, "--socket", str(fleet.socket)) == 0
    assert main(["unlock", "pe:tail_pe", "--socket", str(fleet.socket)]) == 0
