"""Code comes to a PE over the bus: by an unmodified CANopen master, by `heronry bundle send`, and by the manager."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

from agent.loader_bundles import signing_key
from heronry_manager.events import CodeBrought, PeJoined, Reconfigured
from heronry_tools.cli import main
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.bundle import pack
from heronry_wire.bundle_signing import sign
from live.told_events import next_event

pytestmark = pytest.mark.live
PATIENCE_S = 60
NODE = 92
SPEC = """
dg: 1
name: brought
buses: {can0: {bitrate: 1000000}}
pes:
  blank: {node_id: 92, buses: [can0], cpu: 1.0, ram: 64KiB, flash: 256KiB}
  other: {node_id: 93, buses: [can0], cpu: 1.0, ram: 64KiB, flash: 256KiB}
variables:
  speed: {type: FLOAT, unit: m/s}
modules:
  source: {image: "over_the_bus:Source", runs_on: [blank], gives: {speed: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 20}
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
        print("speed", inputs["speed"].value, flush=True)
        return {}
"""


def bundle_file(folder: Path, key: Path, version: int, does: str = "pass", filler: str = "") -> Path:
    code = {"over_the_bus.py": (SOURCE % (filler, does, version)).encode()}
    file = folder / f"v{version}.bundle"
    file.write_bytes(sign(pack("brought", version, ("over_the_bus:Source",), code), key).content)
    return file


class Nodes:
    """The processes on a software bus."""

    def __init__(self, bus: Path, folder: Path) -> None:
        self.folder, self.flags = folder, ["-i", "softbus", "-c", str(bus)]
        self.running: list[subprocess.Popen[str]] = []
        self.key = signing_key(folder)
        self.spec = folder / "brought.dg.yaml"
        self.spec.write_text(SPEC)
        home = folder / "home"
        home.mkdir()
        (home / "at_home.py").write_text(SINK)
        self.home = str(home)

    def start(self, name: str, *words: str, home: str = "") -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", *words, *self.flags, "--until-eof"]
        with (self.folder / f"{name}.log").open("a") as log:
            self.running.append(
                subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True,
                    env={"PATH": "/usr/bin:/bin", "PYTHONPATH": home},
                )
            )  # fmt: skip
        return self.running[-1]

    def said(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def wait(self, name: str, text: str) -> str:
        """Wait until a node has said something."""
        end_s = time.monotonic() + PATIENCE_S
        while text not in self.said(name):
            assert time.monotonic() < end_s, self.said(name)
            time.sleep(0.05)
        return self.said(name)

    def agent(self, pe: str, *more: str) -> "subprocess.Popen[str]":
        table = self.folder / f"{pe}.table"
        assert main(["table", str(self.spec), pe, "-o", str(table), "--contingencies", "none"]) == 0
        return self.start(pe, "heronry_agent", "--table", str(table), *more, home=self.home if pe == "other" else "")

    def blank(self) -> "subprocess.Popen[str]":
        return self.agent("blank", "--code-dir", str(self.folder / "code"), "--code-key", f"{self.key}.pub")

    def manager(self, *more: str) -> "subprocess.Popen[str]":
        return self.start(
            "manager", "heronry_tools.cli", "manager", str(self.spec), "--json", "--contingencies", "none",
            "--state-dir", str(self.folder), "--socket", str(self.folder / "manager.sock"), *more, home=self.home,
        )  # fmt: skip

    def send(self, bundle: Path, *more: str) -> int:
        return main(["bundle", "send", str(bundle), str(self.spec), "blank", *self.flags, *more])

    def order(self, *words: str) -> int:
        return main([words[0], "--socket", str(self.folder / "manager.sock"), *words[1:]])

    def end(self) -> None:
        for process in self.running:
            process.send_signal(signal.SIGTERM)
        for process in self.running:
            process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[Nodes]:
    with start_hub(tmp_path / "can0.sock", 1_000_000) as hub:
        nodes = Nodes(hub.path, tmp_path)
        try:
            yield nodes
        finally:
            nodes.end()


def test_the_manager_brings_code_that_a_pe_lacks_and_it_runs(nodes: Nodes) -> None:
    (nodes.folder / "bundles").mkdir()
    bundle_file(nodes.folder / "bundles", nodes.key, 3)
    nodes.blank()
    nodes.agent("other")
    manager = nodes.manager("--bundles", str(nodes.folder / "bundles"))
    brought = next_event(manager.stdout, CodeBrought, pe="blank")
    assert (brought.bundle, brought.version) == ("brought", 3)
    next_event(manager.stdout, Reconfigured)
    nodes.wait("other", "speed 3.0")


@pytest.mark.soak
def test_the_operator_brings_code_and_clears_the_fault(nodes: Nodes, capsys: pytest.CaptureFixture[str]) -> None:
    nodes.blank()
    nodes.agent("other")
    manager = nodes.manager()
    next_event(manager.stdout, PeJoined, pe="blank")
    next_event(manager.stdout, PeJoined, pe="other")
    nodes.wait("blank", "over_the_bus:Source cannot be run here")
    file = bundle_file(nodes.folder, nodes.key, 3)
    capsys.readouterr()
    assert nodes.send(file) == 0
    assert "is on blank, node 92" in capsys.readouterr().out
    assert nodes.order("clear", "module:source") == 0
    next_event(manager.stdout, Reconfigured)
    nodes.wait("other", "speed 3.0")


def test_an_unmodified_master_downloads_a_bundle_by_the_book(nodes: Nodes) -> None:
    nodes.blank()
    nodes.wait("blank", "PE blank of brought")
    content = bundle_file(nodes.folder, nodes.key, 5).read_bytes()
    network = canopen.Network(can.Bus(interface="softbus", channel=nodes.flags[-1]))
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
