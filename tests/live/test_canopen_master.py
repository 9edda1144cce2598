"""An unmodified CANopen master at a real agent: on a desk without a manager, and in flight."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any

import canopen
import pytest
from canopen.sdo.client import SdoClient

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.pe_table import PeTable
from live.test_nodes import Aircraft

pytestmark = [pytest.mark.live, pytest.mark.xdist_group("desk")]  # there is one for all
reads_long = pytest.mark.timing  # between two segments the agent waits for so long and no longer

PATIENCE_S = 20.0
SPEC = shipped_spec_path("elevator_and_chute")
PE = "tail_pe"
EDS = "dbc/heronry_pe.eds"


class Desk:
    """One agent on a bus of its own, and a master."""

    def __init__(self, folder: Path, interface: str, channel: str) -> None:
        self.spec = load(SPEC)
        self.node = self.spec.pes[PE].node_id
        self.table = write_tables(self.spec, (PE,), folder)[PE]
        self.place = {"interface": interface, "channel": channel}
        self.network = canopen.Network()
        self.network.connect(**self.place)
        self.remote: Any = self.network.add_node(self.node, EDS)  # type: ignore[no-untyped-call]
        flags = ["--simulated", "--table", str(self.table), "-i", interface, "-c", channel, "--until-eof"]
        self.agent = subprocess.Popen(
            [sys.executable, "-m", "heronry_agent", *flags], stdin=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.remote.nmt.wait_for_bootup(PATIENCE_S)

    def close(self) -> None:
        self.network.disconnect()
        self.agent.kill()
        self.agent.communicate()


def reset(nmt: Any) -> None:
    """Reset a node, and hear its boot-up; `wait_for_bootup` misses one that comes before it waits."""
    booted = Event()
    nmt.add_heartbeat_callback(lambda state: None if state else booted.set())
    nmt.state = "RESET"
    assert booted.wait(PATIENCE_S)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client waits for 0.3 s, and a busy machine may take longer."""
    monkeypatch.setattr(SdoClient, "RESPONSE_TIMEOUT", PATIENCE_S)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """One for all tests: each leaves the agent unconfigured, with the table that it has."""
    folder = tmp_path_factory.mktemp("desk")
    with start_hub(folder / "can0.sock", 1_000_000) as hub:
        desk = Desk(folder, "softbus", str(hub.path))
        yield desk
        desk.close()


def test_it_reads_the_identity_of_the_pe_and_what_may_run_there(desk: Desk) -> None:
    sdo = desk.remote.sdo
    assert [number.raw for number in sdo["Identity object"].values()] == [0, 0x5045, 1, 0]
    assert sdo["Spec of this PE"]["Name of this PE"].raw == PE
    assert sdo["Spec of this PE"]["Digest of the spec"].raw in desk.table.read_text()
    table = PeTable.from_json(desk.table.read_text())
    assert [name.raw for name in sdo["Module name"].values()] == [module.name for module in table.modules]
    assert {state.raw for state in sdo["Module state"].values()} == {0}


@reads_long
def test_it_gets_the_eds_from_the_pe_itself(desk: Desk) -> None:
    network = canopen.Network()
    network.connect(**desk.place)
    remote: Any = network.add_node(desk.node, upload_eds=True)  # type: ignore[no-untyped-call]
    network.disconnect()
    assert list(remote.object_dictionary) == list(desk.remote.object_dictionary)


def test_it_sets_the_heartbeat_and_commands_by_nmt(desk: Desk) -> None:
    nmt, heartbeat = desk.remote.nmt, desk.remote.sdo["Producer heartbeat time"]
    heartbeat.raw = 100
    assert heartbeat.raw == 100
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
        nmt.state = state
        nmt.wait_for_heartbeat(PATIENCE_S)
        assert nmt.state == state
    reset(nmt)
    assert heartbeat.raw == 1000


@reads_long
def test_it_reads_and_writes_by_blocks(desk: Desk) -> None:
    table = desk.remote.sdo["Table of this PE"]
    with table.open("rb", block_transfer=True) as stream:
        read = stream.read()
    assert read == desk.table.read_bytes().strip()
    with table.open("wb", size=len(read), block_transfer=True, buffering=7000) as stream:
        stream.write(read)
    with (
        pytest.raises(canopen.SdoAbortedError) as refused,
        table.open("wb", size=len(read), block_transfer=True, buffering=7000) as stream,
    ):
        stream.write(read.replace(PE.encode(), b"tail_ep"))
    assert refused.value.code == 0x0800_0022


def test_the_documented_session_runs(desk: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    page = Path("docs/canopen.md").read_text(encoding="utf-8")
    (session,) = re.findall(r"^```pycon\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    lines = [line.removeprefix(">>> ") for line in session.splitlines()]
    for spoken, here in (
        ('interface="socketcan", channel="can0"', "**place"),
        ("add_node(92, ", f"add_node({desk.node}, "),
    ):
        lines = [line.replace(spoken, here) for line in lines]
    names: dict[str, Any] = {"place": desk.place}
    exec("\n".join(lines), names)
    names["network"].disconnect()
    said = capsys.readouterr().out.splitlines()
    assert said[0] == desk.spec.name
    assert desk.remote.sdo["Producer heartbeat time"].raw == 200


@reads_long
def test_in_flight_it_reads_and_cannot_stop_anything(tmp_path: Path) -> None:
    with Aircraft(tmp_path, SPEC) as aircraft, canopen.Network() as network:
        aircraft.start_agents()
        epoch = aircraft.start_manager().event(events.Reconfigured).epoch
        network.connect(interface="softbus", channel=str(aircraft.folder / "can0.sock"))
        remote: Any = network.add_node(aircraft.spec.pes[PE].node_id, EDS)  # type: ignore[no-untyped-call]
        state = remote.sdo["State of this PE"]
        incarnation = state["Incarnation"].raw
        for command in ("STOPPED", "RESET"):
            network.nmt.state = command  # everybody
        with remote.sdo["Table of this PE"].open("rb", block_transfer=True) as stream:
            assert stream.read().startswith(b"{")
        assert state["Running epoch"].raw >= epoch
        assert state["Incarnation"].raw == incarnation
        assert 1 in {module.raw for module in remote.sdo["Module state"].values()}
        assert remote.sdo["Counters"]["Frames not understood or not obeyed"].raw >= 2
