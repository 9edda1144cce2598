"""Code comes to a PE over the bus: by an unmodified CANopen master, by `heronry bundle send`, and by the manager."""

import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

from agent.loader_bundles import signing_key
from heronry_agent.loader.folder import Folder
from heronry_agent.loader.store import Store
from heronry_manager.events import CodeBrought, PeJoined, Reconfigured, TableBrought
from heronry_tools.cli import main
from heronry_wire.bundle import pack
from heronry_wire.bundle_signing import sign
from live.node_processes import PATIENCE_S, Nodes, nodes_on_a_bus
from live.told_events import next_event

pytestmark = pytest.mark.live
NODE = 92
SPEC = """
dg: 1
name: brought
buses: {can0: {bitrate: 1000000, heartbeat_ms: 200}}
pes:
  blank: {node_id: 92, buses: [can0], cpu: 1.0, ram: 64KiB, flash: 256KiB}
  other: {node_id: 93, buses: [can0], cpu: 1.0, ram: 64KiB, flash: 256KiB}
variables:
  speed: {type: FLOAT, unit: m/s}
modules:
  source: {image: "over_the_bus:Source", runs_on: [blank], gives: {speed: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 20,
           restarts: 3}
  sink: {image: "at_home:Sink", runs_on: [other], needs: speed, cpu: 0.1, ram: 1KiB, rate_hz: 20}
functions:
  telling: {output: sink, criticality: C, priority: 10}
contingency: {faults: 1}
"""
SOURCE = """
from heronry_agent.module import Module
FILLER = %r
class Source(Module):
    def __init__(self, context):
        super().__init__(context)
        self.steps = 0
    def step(self, inputs):
        self.steps += 1
        %s
        return {"speed": float(%d)}
"""
SINK = """
from heronry_agent.module import Module
class Sink(Module):
    def step(self, inputs):
        speed = inputs.get("speed")
        if speed is not None:
            print("speed", speed.value, flush=True)
        return {}
"""


def bundle_file(folder: Path, key: Path, version: int, does: str = "pass", filler: str = "") -> Path:
    code = {"over_the_bus.py": (SOURCE % (filler, does, version)).encode()}
    file = folder / f"v{version}.bundle"
    file.write_bytes(sign(pack("brought", version, ("over_the_bus:Source",), code), key).content)
    return file


class CodeNodes(Nodes):
    """A PE that takes code over the bus, another one that has its own, and their manager."""

    def __init__(self, bus: Path, folder: Path) -> None:
        super().__init__(bus, folder)
        self.key, self.spec = signing_key(folder), folder / "brought.dg.yaml"
        self.spec.write_text(SPEC)
        (folder / "home").mkdir()
        (folder / "home" / "at_home.py").write_text(SINK)
        self.home = str(folder / "home")
        self.code = ["--code-dir", str(folder / "code"), "--code-key", f"{self.key}.pub"]

    def with_table(self, pe: str, *more: str) -> "subprocess.Popen[str]":
        table = self.folder / f"{pe}.table"
        assert main(["table", str(self.spec), pe, "-o", str(table), "--contingencies", "none"]) == 0
        return self.agent(pe, "--table", str(table), *more, code=self.home if pe == "other" else "")

    def blank(self) -> "subprocess.Popen[str]":
        return self.with_table("blank", *self.code)

    def flown(self, *more: str) -> Iterable[str]:
        return self.manager(str(self.spec), *more, code=self.home)

    def send(self, bundle: Path, *more: str) -> int:
        return main(["bundle", "send", str(bundle), str(self.spec), "blank", *self.bus, *more])

    def order(self, *words: str) -> int:
        return main([words[0], "--socket", str(self.socket), *words[1:]])


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[CodeNodes]:
    with nodes_on_a_bus(tmp_path, CodeNodes) as nodes:
        yield nodes


def test_the_manager_brings_code_that_a_pe_lacks_and_it_runs(nodes: CodeNodes) -> None:
    (nodes.folder / "bundles").mkdir()
    bundle_file(nodes.folder / "bundles", nodes.key, 3)
    nodes.blank()
    nodes.with_table("other")
    manager = nodes.flown("--bundles", str(nodes.folder / "bundles"))
    brought = next_event(manager, CodeBrought, pe="blank")
    assert (brought.bundle, brought.version) == ("brought", 3)
    next_event(manager, Reconfigured)
    nodes.wait("other", "speed 3.0")


@pytest.mark.soak
@pytest.mark.parametrize("keyed", [False, True])
def test_a_node_with_nothing_but_its_node_id_gets_its_table_and_its_code(nodes: CodeNodes, keyed: bool) -> None:
    (nodes.folder / "bundles").mkdir()
    bundle_file(nodes.folder / "bundles", nodes.key, 3)
    more: list[str] = []
    if keyed:
        assert main(["key", str(nodes.folder / "fleet.key")]) == 0
        more = ["--key", str(nodes.folder / "fleet.key")]
    nodes.agent("blank", "--node", str(NODE), *nodes.code, *more)
    nodes.with_table("other", *more)
    manager = nodes.flown("--bundles", str(nodes.folder / "bundles"), *more)
    next_event(manager, TableBrought, pe="blank")
    next_event(manager, CodeBrought, pe="blank")
    nodes.wait("other", "speed 3.0")


@pytest.mark.soak
def test_the_operator_brings_code_and_clears_the_fault(nodes: CodeNodes, capsys: pytest.CaptureFixture[str]) -> None:
    nodes.blank()
    nodes.with_table("other")
    manager = nodes.flown()
    for _ in range(2):  # the PEs join in any order
        next_event(manager, PeJoined)
    nodes.wait("blank", "over_the_bus:Source cannot be run here")
    file = bundle_file(nodes.folder, nodes.key, 3)
    capsys.readouterr()
    assert nodes.send(file) == 0
    assert "is on blank, node 92" in capsys.readouterr().out
    end_s = time.monotonic() + PATIENCE_S
    while nodes.order("clear", "module:source") != 0:  # a manager that has just started takes no order
        assert time.monotonic() < end_s
        time.sleep(0.5)
    next_event(manager, Reconfigured)
    nodes.wait("other", "speed 3.0")


def test_an_unmodified_master_downloads_a_bundle_by_the_book(nodes: CodeNodes) -> None:
    nodes.blank()
    nodes.wait("blank", "PE blank of brought")
    content = bundle_file(nodes.folder, nodes.key, 5).read_bytes()
    network = canopen.Network(can.Bus(interface="softbus", channel=nodes.bus[-1]))
    network.connect()
    sdo: Any = network.add_node(NODE, canopen.ObjectDictionary()).sdo
    sdo.RESPONSE_TIMEOUT = 5.0
    try:
        for order in (b"\0", b"\3"):  # stop, clear
            sdo.download(0x1F51, 1, order)
            wait_for_flash(sdo)
        with sdo.open(0x1F50, 1, "wb", size=len(content), block_transfer=True, buffering=7000) as stream:
            stream.write(content)
        assert wait_for_flash(sdo) == 0
        sdo.download(0x1F51, 1, b"\1")
        assert wait_for_flash(sdo) == 0
        assert sdo.upload(0x1F56, 1) == (5).to_bytes(4, "little")
        assert sdo.upload(0x1F51, 1) == b"\1"
    finally:
        network.disconnect()


def wait_for_flash(sdo: Any) -> int:
    """Wait until the loader is not at work; returns its error, as 1F57h says it."""
    end_s = time.monotonic() + PATIENCE_S
    while (status := int.from_bytes(sdo.upload(0x1F57, 1), "little")) & 1:
        assert time.monotonic() < end_s
        time.sleep(0.05)
    return status >> 1


BAD = {
    "raises at once": "raise ValueError(self.steps)",
    "hangs": "import time; time.sleep(60)",
    "dies after ten steps": "import os; self.steps < 10 or os._exit(3)",
    "takes all memory": "bytearray(1 << 33)",
}


def with_old_code(nodes: CodeNodes, version: int) -> None:
    """Let the PE have code that it has kept."""
    store = Store(Folder(nodes.folder / "code"))
    store.boot()
    store.receive(bundle_file(nodes.folder, nodes.key, version).read_bytes(), lambda _: None)
    store.start()
    store.confirm()


@pytest.mark.soak
@pytest.mark.parametrize("how", BAD)
def test_bad_code_is_replaced_by_the_code_before_and_the_module_runs_on(nodes: CodeNodes, how: str) -> None:
    with_old_code(nodes, 3)
    nodes.blank()
    nodes.with_table("other")
    nodes.wait("blank", "code of brought, version 3")
    assert nodes.send(bundle_file(nodes.folder, nodes.key, 4, BAD[how])) == 0
    began_s = time.monotonic()
    nodes.flown()
    nodes.wait("blank", "the code before it is back")
    nodes.wait("other", "speed 3.0")
    assert time.monotonic() - began_s < 90
    assert Store(Folder(nodes.folder / "code")).state().code.version == 3
    assert nodes.send(nodes.folder / "v4.bundle") == 2  # it never returns


@pytest.mark.soak
def test_code_that_cannot_be_imported_is_replaced_and_the_module_runs_on(nodes: CodeNodes) -> None:
    with_old_code(nodes, 3)
    nodes.blank()
    nodes.with_table("other")
    broken = pack("brought", 4, ("over_the_bus:Source",), {"over_the_bus.py": b"import nothing_like_this\n"})
    file = nodes.folder / "v4.bundle"
    file.write_bytes(sign(broken, nodes.key).content)
    nodes.wait("blank", "code of brought, version 3")
    assert nodes.send(file) == 0
    nodes.flown()
    nodes.wait("blank", "the code before it is back")
    nodes.wait("other", "speed 3.0")


@pytest.mark.soak
def test_code_that_runs_for_a_minute_is_kept(nodes: CodeNodes) -> None:
    with_old_code(nodes, 3)
    nodes.blank()
    nodes.with_table("other")
    nodes.wait("blank", "code of brought, version 3")
    assert nodes.send(bundle_file(nodes.folder, nodes.key, 4)) == 0
    nodes.flown()
    nodes.wait("other", "speed 4.0")
    assert Store(Folder(nodes.folder / "code")).state().tries is not None
    time.sleep(60)
    nodes.wait("blank", "the code has run for a minute, and is kept")
    assert Store(Folder(nodes.folder / "code")).state().tries is None
    assert nodes.send(bundle_file(nodes.folder, nodes.key, 5), "--no-start") == 0
    assert nodes.send(nodes.folder / "v5.bundle") == 2  # what runs is not touched


@pytest.mark.soak
def test_a_transfer_whose_agent_is_killed_ends_with_the_old_or_the_new_code_whole(nodes: CodeNodes) -> None:
    with_old_code(nodes, 1)
    allowed = {1}
    for version in range(2, 52):
        file = bundle_file(nodes.folder, nodes.key, version, filler=str(list(range(2000 + version))))
        agent = nodes.blank()
        nodes.wait("blank", "code of brought", version - 1)
        sender = subprocess.Popen(
            [sys.executable, "-m", "heronry_tools.cli", "bundle", "send", file, nodes.spec, "blank", *nodes.bus],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        time.sleep(0.8 + (version % 25) * 0.1)
        agent.kill()
        agent.communicate()
        sender.kill()
        sender.wait()
        allowed.add(version)
        state = Store(Folder(nodes.folder / "code")).boot()
        assert state.code is not None
        content = (nodes.folder / "code" / f"slot-{state.active}.bundle").read_bytes()
        assert content == (nodes.folder / f"v{state.code.version}.bundle").read_bytes()
        assert state.code.version in allowed
        if state.tries is not None:
            Store(Folder(nodes.folder / "code")).confirm()
    nodes.running.clear()
