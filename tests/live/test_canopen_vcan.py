"""An unmodified CANopen master at a real agent on a SocketCAN vcan0, recorded by candump, and the programs that can
read the log.

The session is one of a desk: no manager, one PE that runs nothing and executes NMT commands. It is held once; every
test reads its log, most with a program of another project: cantools with our DBC, can-utils, Wireshark's dissector.
"""

import re
import shutil
import subprocess
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import canopen
import pytest
from canopen.sdo.client import SdoClient
from cantools.database import Database

from heronry_tools.cli import main
from heronry_wire.frame import Frame, LoggedFrame, format_log_line
from heronry_wire.identifiers import emcy_id, heartbeat_id, state_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from live.test_canopen_master import EDS, PATIENCE_S, PE, SPEC, Desk, reset
from live.test_demo_vcan import candump, log_lines, read_dbc

pytestmark = pytest.mark.vcan

NO_OBJECT, NO_SUCH_OBJECT = 0x5FFF, 0x0602_0000  # an index, and what becomes of it
DIGEST_SEGMENTS = 10  # of 7 bytes, for 64
HEARTBEAT_MS = 150
NMT_ID, SDO_ANSWERS, SDO_REQUESTS = 0x000, 0x580, 0x600
EMCY = Emergency(FaultCode.REPORTED, 0x81, ElementKind.MODULE, 1, 0)
wireshark_only = pytest.mark.skipif(shutil.which("tshark") is None, reason="Wireshark's tshark is not installed here")


@dataclass(frozen=True)
class Told:
    """What the master learnt by SDO."""

    identity: list[int]
    digest: str
    incarnation: int
    eds: bytes
    abort_code: int


@dataclass(frozen=True)
class Session:
    """What was said, and the log of it."""

    node: int
    told: Told
    log: Path
    frames: list[Frame]
    database: Database


@dataclass(frozen=True)
class Dissected:
    """What Wireshark makes of a frame; an index and an abort code in SDO alone."""

    protocols: str
    info: str
    index: str
    abort_code: str


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = tmp_path_factory.mktemp("session")
    log, dbc = folder / "session.log", folder / "bus.dbc"
    assert main(["dbc", str(SPEC), "-o", str(dbc)]) == 0
    with pytest.MonkeyPatch.context() as patch, candump(log):
        patch.setattr(SdoClient, "RESPONSE_TIMEOUT", PATIENCE_S)
        desk = Desk(folder, "socketcan", "vcan0")
        try:
            told = converse(desk)
        finally:
            desk.close()
    frames = [logged.frame for logged in log_lines(log) if not logged.frame.extended]  # candump's mark is extended
    return Session(desk.node, told, log, frames, read_dbc(dbc))


def converse(desk: Desk) -> Told:
    """One of each: expedited, segmented and block upload, an abort, a download, and NMT to and fro."""
    sdo, nmt = desk.remote.sdo, desk.remote.nmt
    identity = [number.raw for number in sdo["Identity object"].values()]
    digest = sdo["Spec of this PE"]["Digest of the spec"].raw
    incarnation = sdo["State of this PE"]["Incarnation"].raw
    with sdo["Store EDS"].open("rb", block_transfer=True) as stream:
        eds = stream.read()
    with pytest.raises(canopen.SdoAbortedError) as refused:
        sdo.upload(NO_OBJECT, 0)
    sdo["Producer heartbeat time"].raw = HEARTBEAT_MS
    for state in ("OPERATIONAL", "STOPPED"):
        nmt.state = state
        while nmt.wait_for_heartbeat(PATIENCE_S) != state:
            pass  # one that was on its way
    reset(nmt)
    return Told(identity, digest, incarnation, eds, refused.value.code)


@pytest.fixture(scope="module")
def dissected(session: Session) -> dict[int, list[Dissected]]:
    """Frames by identifier, as Wireshark reads them: the session's, and an EMCY, for on a desk nothing fails."""
    log = session.log.with_name("session_and_emcy.log")
    frames = [*session.frames, Frame(emcy_id(session.node), EMCY.encode())]
    log.write_text("".join(format_log_line(LoggedFrame(at, "vcan0", frame)) + "\n" for at, frame in enumerate(frames)))
    fields = ["frame.protocols", "_ws.col.Info", "canopen.sdo.main_idx", "canopen.sdo.abort_code"]
    words = ["tshark", "-r", str(log), "-d", "can.subdissector,canopen", "-T", "fields"]
    words += [word for field in fields for word in ("-e", field)]
    said = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    read = defaultdict(list)
    for frame, line in zip(frames, said, strict=True):
        read[frame.can_id].append(Dissected(*line.split("\t")))
    return read


def test_the_master_gets_an_emergency(session: Session) -> None:
    assert session.told.identity == [0, 0x5045, 1, 0]
    assert re.fullmatch("[0-9a-f]{64}", session.told.digest)
    assert session.told.eds == Path(EDS).read_bytes()
    assert session.told.abort_code == NO_SUCH_OBJECT


def test_cantools_reads_by_field_what_is_not_canopens_own(session: Session) -> None:
    heard = defaultdict[str, list[dict[str, Any]]](list)
    for frame in session.frames:
        if frame.can_id in {NMT_ID, SDO_REQUESTS + session.node, SDO_ANSWERS + session.node}:
            continue
        read: Any = session.database.decode_message(frame.can_id, frame.data)
        heard[session.database.get_message_by_frame_id(frame.can_id).name].append(read)
    assert heard.keys() == {f"STATE_{PE}", f"HEARTBEAT_{PE}"}
    said = [str(heartbeat["canopen_state"]) for heartbeat in heard[f"HEARTBEAT_{PE}"]]
    assert said[0] == "BOOT_UP"
    assert {"OPERATIONAL", "STOPPED"} <= set(said)
    states = [state for state in heard[f"STATE_{PE}"] if state["page"] == 0]
    assert {(str(state["state"]), state["incarnation"]) for state in states} == {
        ("UNCONFIGURED", session.told.incarnation)
    }


def test_can_utils_read_every_frame(session: Session) -> None:
    asc = session.log.with_suffix(".asc")
    subprocess.run(["log2asc", "-I", str(session.log), "-O", str(asc), "vcan0"], check=True)
    with can.ASCReader(asc) as reader:
        read = [Frame(one.arbitration_id, bytes(one.data)) for one in reader if not one.is_extended_id]
    assert read == session.frames


@wireshark_only
def test_wireshark_takes_every_frame_for_canopen_and_none_for_malformed(
    dissected: dict[int, list[Dissected]],
) -> None:
    assert {one.protocols for frames in dissected.values() for one in frames} == {"exported_pdu:can:canopen"}


@wireshark_only
def test_wireshark_names_all_but_state_frames(session: Session, dissected: dict[int, list[Dissected]]) -> None:
    nameless = {can_id for can_id, frames in dissected.items() for one in frames if one.info.startswith("Unknown")}
    assert nameless == {state_id(session.node)}
    assert [one.info for one in dissected[emcy_id(session.node)]] == ["EMCY"]


@wireshark_only
def test_wireshark_follows_nmt(session: Session, dissected: dict[int, list[Dissected]]) -> None:
    who = f"[{session.node:#x}]"
    commands = [one.info for one in dissected[NMT_ID]]
    assert commands == [f"NMT: {command} {who}" for command in ("Start remote node", "Stop remote node", "Reset node")]
    said = [one.info for one in dissected[heartbeat_id(session.node)]]
    boot_up, *states = [f"NMT Error Control: {state} {who}" for state in ("Boot-up", "Operational", "Stopped")]
    assert said[0] == boot_up
    assert said.count(boot_up) == 2
    assert set(states) <= set(said)


@wireshark_only
def test_wireshark_follows_sdo(session: Session, dissected: dict[int, list[Dissected]]) -> None:
    asked = [(one.info, one.index) for one in dissected[SDO_REQUESTS + session.node]]
    for what, index in (("Initiate upload request", "0x1018"), ("Initiate download request", "0x1017")):
        assert (f"Default-SDO (rx): {what}", index) in asked
    assert asked.count(("Default-SDO (rx): Upload segment request", "")) == DIGEST_SEGMENTS
    assert ("Default-SDO (rx): Block upload", "") in asked  # by name; what follows it takes for segments
    answered = [(one.info, one.index, one.abort_code) for one in dissected[SDO_ANSWERS + session.node]]
    assert ("Default-SDO (tx): Initiate upload response", "0x1018", "") in answered
    assert ("Default-SDO (tx): Abort transfer", f"{NO_OBJECT:#x}", f"{NO_SUCH_OBJECT:#010x}") in answered
