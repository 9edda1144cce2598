"""Processes on a software bus change to another spec while they fly, and back."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.events import PeJoined, Reconfigured
from heronry_manager.shell.control_client import call
from heronry_tools.cli import main
from live.node_processes import Nodes, nodes_on_a_bus
from live.test_tables_by_themselves import NODES, SPEC
from live.told_events import next_event

pytestmark = pytest.mark.live

# A computer that stands still for some periods loses no PE.
TEXT = shipped_spec_path(SPEC).read_text().replace("bitrate: 1000000", "bitrate: 1000000, heartbeat_ms: 200")
NEWER = (
    TEXT.replace("state_info: {type: FLOAT}", "state_info: {type: FLOAT, versions: 2}")
    .replace("servo_failure: 1}, cpu: 0.03, ram: 1KiB, flash: 2KiB, rate_hz: 40}",
             "servo_failure: 1}, cpu: 0.03, ram: 1KiB, flash: 2KiB, rate_hz: 50}")
    .replace("modules:\n", "modules:\n  spare_estimator: {image: state_estimator, gives: {state_info: 2}, cpu: 0.02, "
             "ram: 1KiB, flash: 8KiB, rate_hz: 20}\n", 1)
    .replace("functions:\n", "functions:\n  spare: {output: spare_estimator, criticality: D, priority: 5}\n", 1)
)  # fmt: skip


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[Nodes]:
    with nodes_on_a_bus(tmp_path, Nodes) as nodes:
        yield nodes


def test_a_flying_aircraft_takes_another_spec_and_goes_back(
    nodes: Nodes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, socket = tmp_path / "uav.dg.yaml", nodes.socket
    file.write_text(TEXT)
    tables = {pe: tmp_path / f"{pe}.table" for pe in NODES}
    for pe, table in tables.items():
        nodes.agent(pe, "--simulated", "--node", str(NODES[pe]), "--table", str(table))
    manager = nodes.manager(str(file))
    waiting = set(NODES)
    while waiting:
        waiting.discard(next_event(manager, PeJoined).pe)
    next_event(manager, Reconfigured)

    def flies_by() -> str:
        return str((call(socket, AskStatus()).status or {})["spec_digest"])

    def ordered(*words: str) -> None:
        until = time.monotonic() + 60
        while main(["reload", *words, "--socket", str(socket)]):
            assert time.monotonic() < until, capsys.readouterr().err  # a busy computer may lose a PE for a moment
            time.sleep(0.5)

    before = flies_by()
    file.write_text(NEWER)
    ordered(str(file), "--yes")
    after = flies_by()
    assert after != before
    assert all('"spare_estimator"' in table.read_text() for table in tables.values())
    status = call(socket, AskStatus()).status or {}
    assert {pe["state"] for pe in status["pes"].values()} == {"up"}
    ordered("--back")
    assert flies_by() == before
    assert not any('"spare_estimator"' in table.read_text() for table in tables.values())
