"""Agents that are started with nothing but a node-ID and a bus fly, and so does a blank one in the place of another."""

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.tables import Compiler
from heronry_manager.events import AnotherTable, PeJoined, PeLost, Reconfigured, TableBrought
from heronry_tools.cli import main
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.pe_table import PeTable
from lab.slow_spec import slow_spec
from live.node_processes import Nodes, ended, nodes_on_a_bus
from live.told_events import next_event

pytestmark = pytest.mark.live
SPEC = "elevator_and_chute"
NODES = {pe.name: pe.node_id for pe in load(shipped_spec_path(SPEC)).pes.values()}


class BlankNodes(Nodes):
    """Agents that are started with nothing but a node-ID and a bus."""

    def blank(self, pe: str) -> "subprocess.Popen[str]":
        return self.agent(pe, "--simulated", "--node", str(NODES[pe]))


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[BlankNodes]:
    with nodes_on_a_bus(tmp_path, BlankNodes) as nodes:
        yield nodes


def test_blank_nodes_fly_and_one_is_replaced_in_flight(nodes: BlankNodes) -> None:
    agents = {pe: nodes.blank(pe) for pe in NODES}
    manager = nodes.manager(SPEC)
    brought = [next_event(manager, TableBrought).pe for _ in NODES]
    assert sorted(brought) == sorted(NODES)
    next_event(manager, PeJoined, pe=brought[-1])
    next_event(manager, Reconfigured)
    agents["tail_pe"].kill()
    next_event(manager, PeLost, pe="tail_pe")
    nodes.blank("tail_pe")
    next_event(manager, TableBrought, pe="tail_pe")
    next_event(manager, PeJoined, pe="tail_pe")
    next_event(manager, Reconfigured)


def test_a_node_that_the_spec_does_not_have_tells_what_it_offers(
    nodes: Nodes, capsys: pytest.CaptureFixture[str]
) -> None:
    agent = nodes.agent("node_101", "--simulated", "--node", "101")
    for _ in range(10):
        code = main(["adopt", SPEC, "101", *nodes.bus])
        if not code:
            break
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "  node_101: {node_id: 101, buses: [can0], cpu: " in said.out
    assert agent.poll() is None


def test_a_pe_is_retired_and_restored(nodes: BlankNodes, tmp_path: Path) -> None:
    file = tmp_path / "slow.dg.yaml"  # a computer that stands still for some periods loses no PE
    file.write_text(
        shipped_spec_path(SPEC).read_text().replace("bitrate: 1000000", "bitrate: 1000000, heartbeat_ms: 200")
    )
    for pe in NODES:
        nodes.blank(pe)
    manager = nodes.manager(str(file))
    waiting = set(NODES)
    while waiting:
        waiting.discard(next_event(manager, PeJoined).pe)
    for order, done in (("retire", "retired"), ("restore", "restored")):
        while main([order, "pe:control_pe", "--socket", str(nodes.socket)]):
            time.sleep(0.5)  # a reconfiguration is under way
        while f"pe:control_pe {done} by the operator" not in next_event(manager, Reconfigured).causes:
            pass  # that of the last PE that has joined


def test_a_damaged_table_and_that_of_another_spec_are_replaced_and_kept(nodes: Nodes, tmp_path: Path) -> None:
    text = shipped_spec_path(SPEC).read_text()
    other = loads(text.replace("priority: ", "priority: 1"), "other.dg.yaml")
    first, second, third = NODES
    files = {pe: tmp_path / f"{pe}.table" for pe in NODES}
    files[first].write_text(Compiler(other).table(first).to_json())
    files[second].write_text(files[first].read_text()[:-7])
    for pe, file in files.items():
        nodes.agent(pe, "--simulated", "--node", str(NODES[pe]), "--table", str(file))
    manager = nodes.manager(SPEC)
    next_event(manager, AnotherTable, pe=first)
    next_event(manager, TableBrought, pe=first)
    next_event(manager, PeJoined, pe=first)
    next_event(manager, Reconfigured)
    compiler = Compiler(load(shipped_spec_path(SPEC)))
    for pe in (first, second, third):
        assert PeTable.from_json(files[pe].read_text()) == PeTable.from_json(compiler.table(pe).to_json())


BIG_BLUE = load(shipped_spec_path("big_blue"))
RADIO = BIG_BLUE.buses["radio"]


@pytest.mark.soak  # nine agents, a manager with its solver, and two buses
@pytest.mark.parametrize("has_key", [False, True])
def test_nine_nodes_with_a_node_id_and_a_bus_fly_big_blue_and_one_is_replaced(has_key: bool, tmp_path: Path) -> None:
    with start_hub(tmp_path / "can0.sock", 1_000_000) as can0:
        fly_big_blue("big_blue", can0.path, has_key, tmp_path)


@pytest.mark.soak
@pytest.mark.vcan
@pytest.mark.parametrize("has_key", [False, True])
def test_the_same_on_a_vcan(has_key: bool, tmp_path: Path) -> None:
    """The radio is a software bus, as always."""
    slow = slow_spec("big_blue", tmp_path, heartbeat_ms=1000, rates_divided_by=40)
    fly_big_blue(str(slow), "vcan0", has_key, tmp_path)


def fly_big_blue(spec: str, can0: Path | str, has_key: bool, folder: Path) -> None:
    """Start nine blank agents and a manager, and replace one agent in flight."""
    key = folder / "fleet.key"
    assert main(["key", str(key)]) == 0
    more = ["--key", str(key)] if has_key else []
    with (
        start_hub(folder / "radio.sock", RADIO.bitrate) as radio,
        ended(Nodes(can0, folder, *more)) as nodes,
        ended(Nodes(radio.path, folder, "--bitrate", str(RADIO.bitrate), *more)) as beyond,
    ):
        agents = {}
        for pe in BIG_BLUE.pes.values():
            here = nodes if BIG_BLUE.manager.bus in pe.buses else beyond
            other = ["--bus", f"radio=softbus:{radio.path}"] if len(pe.buses) > 1 else []
            agents[pe.name] = here.agent(pe.name, "--simulated", "--node", str(pe.node_id), *other)
        manager = nodes.manager(spec)
        waiting = set(BIG_BLUE.pes)
        while waiting:
            waiting.remove(next_event(manager, TableBrought).pe)
        next_event(manager, Reconfigured)
        agents["payload"].kill()
        next_event(manager, PeLost, pe="payload")
        nodes.agent("payload", "--simulated", "--node", str(BIG_BLUE.pes["payload"].node_id))
        next_event(manager, TableBrought, pe="payload")
        next_event(manager, PeJoined, pe="payload")
        next_event(manager, Reconfigured)
