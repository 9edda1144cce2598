"""`heronry doctor`: what it finds right, what it finds wrong, and the remedies that it gives."""

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import can
import pytest
from can.broadcastmanager import ThreadBasedCyclicSendTask

from heronry_dg.loader import load
from heronry_dg.model import Foreign
from heronry_tools.cli import main
from heronry_tools.commands import doctor as doctor_command
from heronry_tools.commands.doctor import _listen
from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.doctor import computer
from heronry_tools.runtime.doctor.asking import ToldTable, assess_tables
from heronry_tools.runtime.doctor.computer import assess_computer, assess_date, assess_disk, assess_wake_ups
from heronry_tools.runtime.doctor.expected import Expected
from heronry_tools.runtime.doctor.expected_by_spec import expected_by_spec
from heronry_tools.runtime.doctor.interface import assess_interface
from heronry_tools.runtime.doctor.listening import (
    CLOCK_STEP_NS,
    BusNamed,
    Hearing,
    assess_beats,
    assess_channels,
    assess_foreign,
    assess_hearing,
    assess_load,
)
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.bus_opening import open_bus
from heronry_wire.can_interface import CanInterface
from heronry_wire.controller import ControllerState
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id, state_id
from heronry_wire.management import Lease, Step
from heronry_wire.protocol_version import PROTOCOL, Version
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.peers import command_frame
from wire.test_socketcand import Server

GOOD = CanInterface(
    name="can0",
    kind="can",
    is_can=True,
    is_up=True,
    queue_length=10,
    bitrate=1_000_000,
    state=ControllerState.ERROR_ACTIVE,
    restart_ms=100,
    transmit_errors=0,
    receive_errors=0,
    bus_offs=0,
)

SPEC = Expected("small", "ab" * 32, 1_000_000, {92: "nose", 93: "tail"})


def wrong(findings: Iterator[Finding]) -> dict[str, str]:
    return {finding.check: finding.remedy for finding in findings if finding.remedy is not None}


@pytest.fixture(autouse=True)
def _a_computer_that_is_never_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_command, "latest_wake_up_ns", lambda *_: 1_000_000)


# The computer


def test_a_computer_that_is_late_by_more_than_a_heartbeat_is_not_right() -> None:
    in_time, late = assess_wake_ups(7_000_000, 20_000_000), assess_wake_ups(62_000_000, 20_000_000)
    assert in_time.is_right
    assert in_time.says.endswith("a node runs up to 7.0 ms late here: it can keep a heartbeat of 20 ms")
    assert late.says.endswith("62.0 ms late here: it may miss a heartbeat of 20 ms, and be called lost")
    assert late.remedy is not None
    assert "heartbeat_ms: 160" in late.remedy
    assert assess_wake_ups(62_000_000, 80_000_000).is_right


# The interface


def test_a_good_interface_is_right_in_every_way() -> None:
    findings = list(assess_interface("can0", GOOD, 1_000_000))
    assert [finding.check for finding in findings] == ["interface", "queue", "bit rate", "restart", "errors"]
    assert all(finding.is_right for finding in findings)


def test_a_vcan_and_a_driver_that_tells_little_are_right() -> None:
    vcan = CanInterface("vcan0", "vcan", is_can=True, is_up=True, queue_length=1000)
    silent = replace(GOOD, bitrate=None, state=None, transmit_errors=None, receive_errors=None, bus_offs=None)
    for interface in (vcan, silent):
        assert wrong(assess_interface(interface.name, interface, 1_000_000)) == {}


@pytest.mark.parametrize(
    ("interface", "check", "remedy"),
    [
        (None, "interface", "ip link"),
        (replace(GOOD, is_can=False), "interface", "ip -details link show type can"),
        (replace(GOOD, is_up=False), "interface", "ip link set can0 up type can bitrate 1000000 restart-ms 100"),
        (
            replace(GOOD, bitrate=500_000),
            "bit rate",
            "ip link set can0 down && ip link set can0 up type can bitrate 10",
        ),
        (replace(GOOD, restart_ms=0), "restart", "ip link set can0 down && "),
        (replace(GOOD, queue_length=5), "queue", "ip link set can0 txqueuelen 10"),
        (replace(GOOD, transmit_errors=97), "errors", "check termination"),
        (replace(GOOD, state=ControllerState.ERROR_PASSIVE), "errors", "check termination"),
        (replace(GOOD, state=ControllerState.BUS_OFF), "errors", "ip link set can0 down && "),
        (replace(GOOD, bus_offs=2), "bus-off", "check termination"),
    ],
)
def test_whatever_is_wrong_with_an_interface_has_its_remedy(
    interface: CanInterface | None, check: str, remedy: str
) -> None:
    found = wrong(assess_interface("can0", interface, 1_000_000))
    assert list(found) == [check]
    assert found[check].startswith(remedy)


def test_a_vcan_that_is_missing_or_down_is_made_as_a_vcan_is() -> None:
    assert wrong(assess_interface("vcan0", None, None)) == {
        "interface": "ip link add vcan0 type vcan && ip link set vcan0 up"
    }
    down = CanInterface("vcan0", "vcan", is_can=True, is_up=False, queue_length=1000)
    assert wrong(assess_interface("vcan0", down, None)) == {"interface": "ip link set vcan0 up"}


# The bus


def state(node: int, incarnation: int = 1) -> Frame:
    return Frame(state_id(node), StatePage0(PeState.ACTIVE, PeFlags(0), incarnation, 7, 0, 0).encode())


def lease(manager: int, term: int = 1) -> Frame:
    return command_frame(Lease(term, 7, Step.GO_ALL, 0), manager)


def heard(*frames: Frame) -> Hearing:
    hearing = Hearing()
    for frame in frames:
        hearing.take(frame, 0)
    return hearing


def test_a_bus_with_its_nodes_and_one_manager_is_right() -> None:
    findings = list(assess_hearing(heard(lease(126), state(92), state(93), state(93)), SPEC, 3))
    assert wrong(iter(findings)) == {}
    assert [finding.says for finding in findings if finding.check == "nodes"] == ["heard: nose, tail"]


@pytest.mark.parametrize(
    ("frames", "checks"),
    [
        ([], {"bus", "manager", "nodes"}),
        ([state(92), state(93)], {"manager"}),
        ([lease(126), lease(127, 2), state(92), state(93)], {"manager"}),
        ([lease(126), state(92)], {"nodes"}),
        ([lease(126), state(92), state(93), state(94)], {"nodes"}),
        ([lease(126), state(92), state(93, 1), state(93, 9), state(93, 1)], {"node-ID"}),
        ([lease(126), state(92), state(93), Frame(0x88, bytes(8), error=True)], {"bus"}),
        ([lease(126), state(92), state(93), Frame(0x40, bytes(8), error=True)], {"bus"}),
    ],
)
def test_whatever_is_wrong_on_a_bus_is_found(frames: list[Frame], checks: set[str]) -> None:
    assert set(wrong(assess_hearing(heard(*frames), SPEC, 3))) == checks


def test_what_is_no_word_of_ours_is_a_frame_and_nothing_more() -> None:
    strange = [
        Frame(0x1ABCDEF, b"", extended=True),
        Frame(state_id(92), b""),
        Frame(state_id(92), b"\x00"),
        Frame(management_id(126, Command.LEASE), b"\x00"),
        Frame(1000, b"x"),
    ]
    hearing = heard(*strange, state(92))
    assert (hearing.frames, hearing.terms, hearing.incarnations) == (6, {}, {92: [1]})


def test_a_clock_that_is_set_is_found_and_one_that_drifts_is_not() -> None:
    hearing = Hearing()
    for wall_ns, monotonic_ns in ((0, 0), (1_000_100, 1_000_000), (2_000_000, 2_000_000)):
        hearing.clocks(wall_ns, monotonic_ns)
    assert "clock" not in wrong(assess_hearing(hearing, None, 3))
    hearing.clocks(3_000_001 + CLOCK_STEP_NS, 3_000_000)
    assert "clock" in wrong(assess_hearing(hearing, None, 3))


def test_tables_of_two_specs_are_found_and_so_is_a_pe_that_does_not_answer() -> None:
    mine, other = ToldTable(SPEC.digest), ToldTable("cd" * 32)
    assert wrong(assess_tables({92: mine, 93: mine}, SPEC)) == {}
    assert wrong(assess_tables({92: other, 93: other}, None)) == {}
    assert wrong(assess_tables({}, SPEC)) == {}
    assert list(wrong(assess_tables({92: mine, 93: other}, None))) == ["tables"]
    (found,) = (one for one in assess_tables({92: other}, SPEC) if not one.is_right)
    assert found.says == "nose (92) has a table of another spec than small"
    assert list(wrong(assess_tables({92: None}, SPEC))) == ["tables"]
    assert list(wrong(assess_tables(None, SPEC))) == ["tables"]


def test_a_pe_of_another_protocol_is_named_for_that_and_not_for_its_digest() -> None:
    later = ToldTable("cd" * 32, Version(PROTOCOL.major + 1, 0))
    (found,) = (one for one in assess_tables({92: later, 93: ToldTable(SPEC.digest)}, SPEC) if not one.is_right)
    assert (found.check, found.says) == ("protocol", f"nose (92) speaks protocol 2.0, and this computer {PROTOCOL}")
    minor = ToldTable(SPEC.digest, Version(PROTOCOL.major, PROTOCOL.minor + 1))
    assert wrong(assess_tables({92: minor}, SPEC)) == {}


def test_pes_beyond_a_gateway_are_expected_and_only_not_asked() -> None:
    spec = load(Path("dg_specs/big_blue.dg.yaml"))
    can0, radio = expected_by_spec(spec, "can0"), expected_by_spec(spec, "radio")
    assert can0.pes == {pe.node_id: pe.name for pe in spec.pes.values()}
    assert can0.asked == can0.pes.keys() - {100}
    assert (can0.periods_ns[92], can0.periods_ns[100]) == (20_000_000, 200_000_000)
    assert radio.asked == {100}
    everybody = heard(lease(126), *(state(node) for node in can0.pes))
    assert "nodes" not in wrong(assess_hearing(everybody, can0, 3))
    grounded = heard(lease(126), *(state(node) for node in can0.pes if node != 100))
    found = [one.says for one in assess_hearing(grounded, can0, 3) if one.check == "nodes"]
    assert found == ["not heard: ground (100)"]


def test_states_that_come_late_are_told_with_their_pe() -> None:
    expected = replace(SPEC, periods_ns={92: 20_000_000, 93: 200_000_000})
    hearing = Hearing()
    for t_ms in (0, 20, 40, 81, 100):
        hearing.take(state(92), t_ms * 1_000_000)
    hearing.take(state(93), 0)
    hearing.take(state(93), 390_000_000)
    (late,) = assess_beats(hearing, expected)
    assert late.says == "nose was silent for 41 ms, and sends its state every 20 ms"
    assert not late.is_right
    (right,) = assess_beats(hearing, replace(expected, periods_ns={92: 40_000_000, 93: 200_000_000}))
    assert right.is_right
    assert right.says.endswith("the longest silence was 390 ms of 200 ms")


def test_a_bus_with_more_frames_than_the_spec_allows_is_overloaded() -> None:
    hearing = heard(*[Frame(2000, bytes(8))] * 1000)  # of 135 bits each
    (load_,) = assess_load(hearing, replace(SPEC, most_load=0.8), 1.0)
    assert load_.is_right
    assert load_.says == "13.5% of the bit rate are used, and 80% may be"
    (over,) = assess_load(hearing, replace(SPEC, most_load=0.8), 0.1)
    assert not over.is_right
    assert not list(assess_load(hearing, SPEC, 1.0)), "a table does not tell how much may be used"


# The computer, and the command


def test_a_kernel_without_can_and_a_package_that_is_missing_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert wrong(assess_computer(needs_can=False)) == {}
    monkeypatch.setattr(computer, "knows_can", lambda: False)
    monkeypatch.setattr(computer, "_NEEDED", ("heronry", "no-such-package"))
    assert wrong(assess_computer(needs_can=True)).keys() == {"versions", "kernel"}


def test_a_date_before_files_that_are_here_is_wrong(tmp_path: Path) -> None:
    file, written_s = tmp_path / "spec", 1_700_000_000.0
    file.touch()
    os.utime(file, (written_s, written_s))
    assert assess_date(written_s, [file, tmp_path / "none"]).is_right
    wrong_date = assess_date(1e6, [file])
    assert wrong_date.says.startswith("it is 1970-01-12")
    assert not wrong_date.is_right


def test_a_disk_that_is_full_or_read_only_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "MB left" in assess_disk(tmp_path).says
    assert not assess_disk(tmp_path / "none").is_right
    real = list(os.statvfs(tmp_path))
    for flags, blocks, says in ((os.ST_RDONLY, 10**9, "read-only"), (0, 100, " MB left")):
        told = os.statvfs_result((4096, 4096, *real[2:4], blocks, *real[5:8], flags, real[9]))
        monkeypatch.setattr(os, "statvfs", lambda _, told=told: told)
        assert says in assess_disk(tmp_path).says
        assert not assess_disk(tmp_path).is_right


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[str]:
    process = start_hub(tmp_path / "can0.sock", 1_000_000)
    yield str(process.path)
    process.close()


def test_on_an_empty_bus_it_says_what_to_start_and_ends_with_1(hub: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "elevator_and_chute", "-i", "softbus", "-c", hub, "--seconds", "0.1", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is False
    assert {one["check"] for one in told["findings"] if not one["ok"]} == {"bus", "manager", "nodes"}
    assert all((one["type"] is None) == one["ok"] for one in told["findings"])
    told_bus = {one["check"]: one["type"] for one in told["findings"] if one["check"] in ("bus", "manager", "nodes")}
    agents = f"pe-agent --table PE.table -i softbus -c {hub}   (for each PE)"  # no systemctl: there is no such unit
    assert told_bus == {"bus": agents, "manager": f"heronry manager SPEC -i softbus -c {hub}", "nodes": agents}


def test_two_managers_on_a_bus_of_this_desk_are_two_processes() -> None:
    found = wrong(assess_hearing(heard(lease(126), lease(127)), None, 3, BusNamed("softbus", "can0")))
    assert found["manager"] == "kill PID   (of one of the processes 'heronry manager')"


def test_a_software_bus_of_another_bit_rate_is_told_as_that(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with start_hub(tmp_path / "can0.sock", 500_000) as hub:
        words = ["doctor", "elevator_and_chute", "-i", "softbus", "-c", str(hub.path), "--seconds", "0.1"]
        assert main(words) == 1
        out = capsys.readouterr().out
        assert "the bus runs at 500000 bit/s, not at 1000000; serve it with -b 1000000" in out
        assert "nothing was heard" not in out
        main([*words, "-b", "500000"])
        assert "nothing was heard" in capsys.readouterr().out


def test_a_node_that_has_its_table_alone_compares_with_that(
    hub: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = Path("dg_specs/elevator_and_chute.dg.yaml")
    table = write_tables(load(file), ("tail_pe",), tmp_path)["tail_pe"]
    with can.Bus(interface="softbus", channel=hub) as bus:
        for one in (lease(126), state(92)):
            bus.send(can.Message(arbitration_id=one.can_id, data=one.data, is_extended_id=False))
        assert main(["doctor", str(table), "-i", "softbus", "-c", hub, "--seconds", "0.1"]) == 1
    out = capsys.readouterr().out
    assert "not heard: node " in out
    assert out.endswith("things are not right\n")


def test_behind_a_socketcand_it_hears_frames_that_come_at_once() -> None:
    with closing(Server()) as server:
        greeting = server.expect()
        opened = open_bus({"interface": "socketcand", "channel": f"can0@{server.address}"})
        greeting.join()
        assert server.client is not None
        said = (lease(126), lease(127), state(92))
        server.client.sendall("".join(f"< frame {one.can_id:03x} 1.0 {one.data.hex()} >" for one in said).encode())
        with opened.bus:
            heard = _listen({"can0": opened}, 0.2, None)
    assert heard.terms.keys() == {126, 127}
    assert heard.incarnations.keys() == {92}


def test_a_bus_that_cannot_be_opened_is_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "-i", "softbus", "-c", str(tmp_path / "none.sock")]) == 1
    assert "no bus answers there" in capsys.readouterr().out
    assert main(["doctor", "-i", "socketcan", "-c", "no_such_can"]) == 1
    out = capsys.readouterr().out
    assert "this kernel does not support CAN" in out or "there is no interface no_such_can" in out


def test_on_a_replicated_bus_it_names_nodes_that_are_on_one_channel_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = [str(tmp_path / name) for name in ("one.sock", "two.sock")]
    with start_hub(places[0]), start_hub(places[1]), can.Bus(interface="softbus", channel=places[0]) as first:
        second = can.Bus(interface="softbus", channel=places[1])
        with second, ExitStack() as ended:
            for bus, frames in ((first, (lease(126), state(92), state(93))), (second, (lease(126), state(92)))):
                for one in frames:
                    message = can.Message(arbitration_id=one.can_id, data=one.data, is_extended_id=False)
                    task = bus.send_periodic(message, 0.02)
                    assert isinstance(task, ThreadBasedCyclicSendTask)
                    ended.callback(
                        task.thread.join
                    )  # python-can closes a bus without waiting for a thread that still sends
                    ended.callback(task.stop)
            words = ["doctor", "-i", "softbus", "-c", ",".join(places), "--seconds", "0.5"]
            assert main(words) == 1
            assert f"not heard: 93 on {places[1]}" in capsys.readouterr().out


def test_a_replicated_bus_on_which_every_node_is_heard_twice_is_right() -> None:
    hearing = Hearing(on_channel={"can0": set(), "can1": set()})
    for channel in hearing.on_channel:
        for frame in (lease(126), state(92), Frame(0x300, b"")):
            hearing.take_copy(channel, frame)
    hearing.take_copy("can1", state(93)._replace(extended=True))
    assert assess_channels(hearing, SPEC).is_right
    hearing.take_copy("can0", state(93))
    assert assess_channels(hearing, SPEC).says == "not heard: tail on can1"


def test_a_time_that_makes_no_sense_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "-i", "softbus", "-c", "x", "--seconds", "0"]) == 2
    assert "--seconds 0" in capsys.readouterr().err


# Foreign frames


DECLARED = (
    Foreign(1793, None, extended=False, data_bytes=4, period_ns=100_000_000),
    Foreign(None, (2048, 4096), extended=True, data_bytes=8, period_ns=10_000_000),
)


def foreign_findings(*frames: Frame, foreign: tuple[Foreign, ...] = DECLARED) -> list[Finding]:
    hearing = Hearing()
    for frame in frames:
        hearing.take(frame, 0)
    expected = replace(SPEC, own=frozenset({257, 315}), foreign=foreign)
    return list(assess_foreign(hearing, expected, 1.0))


def test_what_is_declared_and_not_more_is_right() -> None:
    own = [Frame(257, bytes(8)), Frame(315, bytes(8)), Frame(0, bytes(2)), Frame(2000, bytes(8))]
    heard = [Frame(1793, bytes(4))] * 11 + [Frame(2048 + n, bytes(8), extended=True) for n in range(50)]
    first, second = foreign_findings(*own, *heard)
    assert first.is_right
    assert first.says == "identifier 1793: 0.10% of the bit rate, 0.10% declared"  # 11 and 10 frames of 95 bits
    assert second.is_right
    assert second.says == "identifiers 2048 to 4096 (29 bits): 0.80% of the bit rate, 1.60% declared"
    assert foreign_findings(*own)[0].says == "identifier 1793: not heard, 0.10% declared"


def test_what_comes_more_often_or_is_longer_than_declared_is_not_right() -> None:
    more, longer = foreign_findings(
        *[Frame(1793, bytes(4))] * 12,
        Frame(2048, bytes(8), extended=True),
        foreign=(DECLARED[0], replace(DECLARED[1], data_bytes=7)),
    )
    assert more.remedy == "correct period_ms in the spec: 12 frames came in 1 s, and 11 may"
    assert longer.remedy == "correct bytes in the spec: a frame has 8 data bytes"


def test_each_sender_that_is_not_declared_is_named_with_its_load_and_its_entry() -> None:
    heard = [Frame(1793, bytes(3))] * 40 + [Frame(1793, bytes(8), extended=True)]
    standard, extended = foreign_findings(*heard, foreign=())
    assert standard.says == "identifier 1793 is not declared: 40 frames/s, 0.34% of the bit rate"
    assert standard.remedy == "add to 'foreign' of the bus: {identifier: 1793, bytes: 3, period_ms: 25}"
    assert extended.remedy is not None
    assert "{identifier: 1793, extended: true, bytes: 8, period_ms: 1000}" in extended.remedy


def test_without_a_spec_nothing_is_known_to_be_foreign() -> None:
    hearing = Hearing()
    hearing.take(Frame(1793, b""), 0)
    assert not list(assess_foreign(hearing, SPEC, 1.0))
