"""A PE that is started with only its node-ID, and gets its table over the bus."""

import logging
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.commands import send_table as send_table_command
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from heronry_wire.identifiers import heartbeat_id, state_id

pytestmark = pytest.mark.live

PATIENCE_S = 30.0
SPEC, PE = "elevator_and_chute", "tail_pe"
NODE = load(shipped_spec_path(SPEC)).pes[PE].node_id


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[HubProcess]:
    with start_hub(tmp_path / "can0.sock", 1_000_000) as hub:
        yield hub


class WaitingPe:
    """The process."""

    def __init__(self, hub: HubProcess, *more: str) -> None:
        self.bus = can.Bus(interface="softbus", channel=str(hub.path))
        words = [sys.executable, "-m", "heronry_agent", "--node", str(NODE), "-i", "softbus", "-c", str(hub.path)]
        words.append("--simulated")
        self.process = subprocess.Popen([*words, *more], stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def hear(self, identifier: int) -> can.Message:
        while True:
            message = self.bus.recv(PATIENCE_S)
            assert message is not None, "it is silent"
            if message.arbitration_id == identifier:
                return message

    def end(self) -> tuple[int, str]:
        _, said = self.process.communicate(timeout=PATIENCE_S)
        self.bus.shutdown()
        return self.process.returncode, said


def send(hub: HubProcess, spec: str, pe: str = PE, *more: str) -> int:
    return main(["send-table", spec, pe, "-i", "softbus", "-c", str(hub.path), "--contingencies", "none", *more])


def test_a_pe_waits_gets_its_table_and_starts(hub: HubProcess, capsys: pytest.CaptureFixture[str]) -> None:
    pe = WaitingPe(hub)
    assert bytes(pe.hear(heartbeat_id(NODE)).data) == b"\x00"
    assert send(hub, SPEC) == 0
    assert capsys.readouterr().out.startswith(f"{PE}, node {NODE}, has its table: ")
    pe.hear(state_id(NODE))
    assert send(hub, SPEC) == 0  # it has it
    other = pe_of("big_blue")
    assert send(hub, "big_blue", other) == 0  # it runs nothing yet
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"{other}, node {NODE}, has its table: ")
    pe.hear(state_id(NODE))
    pe.process.send_signal(signal.SIGTERM)
    code, said = pe.end()
    assert code == 0
    assert f"table: PE {PE} of {SPEC}" in said
    assert f"table: PE {other} of big_blue" in said


def pe_of(spec: str) -> str:
    """The PE with the same node-ID in another spec."""
    return next(pe.name for pe in load(shipped_spec_path(spec)).pes.values() if pe.node_id == NODE)


def test_a_pe_that_waits_can_be_stopped(hub: HubProcess) -> None:
    for how in (signal.SIGTERM, signal.SIGINT, None):
        pe = WaitingPe(hub, "--until-eof")
        pe.hear(heartbeat_id(NODE))
        if how is not None:
            pe.process.send_signal(how)
        assert pe.end() == (0, "")


def test_two_cannot_wait_with_one_number(hub: HubProcess) -> None:
    first = WaitingPe(hub, "--until-eof")
    first.hear(heartbeat_id(NODE))
    code, said = WaitingPe(hub).end()
    assert code == 1
    assert said == f"pe-agent: another node on the bus has node-ID {NODE}; change one of the two\n"
    assert first.end() == (0, "")


def test_without_a_waiting_pe_the_command_reports_it(
    hub: HubProcess, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(send_table_command, "_ANSWER_WITHIN_S", 0.1)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as in a user's process: pytest handles logs
    for more in ((), ("--json",)):
        assert send(hub, SPEC, PE, *more) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith(f"heronry: node {NODE} did not take the table (No SDO response received); ")
        assert said.err.count("\n") == 1
    assert send(hub, SPEC, "nobody") == 2
    assert "no PE is named 'nobody'" in capsys.readouterr().err


@pytest.mark.parametrize("node", ["91", "126", "x"])
def test_only_a_pe_can_wait(node: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "heronry_agent", "--node", node], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith(f"{node} is not the node-ID of a PE; use 92 to 125")
