"""Link status events as sentences and counts; and Linux's reports on a controller and an interface."""

import socket
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.bus_health import TELL_AGAIN_NS, BusHealth
from heronry_wire.can_interface import CanInterface, parse_link, read_interface
from heronry_wire.controller import ControllerReport, ControllerState, read_error_frame
from heronry_wire.frame import Frame
from heronry_wire.service_manager import ServiceManager


def error_frame(classes: int, detail: int = 0) -> Frame:
    return Frame(classes, bytes((0, detail, 0, 0, 0, 0, 0, 0)), error=True)


@pytest.mark.parametrize(
    ("frame", "state", "kinds"),
    [
        (error_frame(0x40), ControllerState.BUS_OFF, ()),
        (error_frame(0x100), ControllerState.ERROR_ACTIVE, ()),
        (error_frame(0x04, 0x40), ControllerState.ERROR_ACTIVE, ()),
        (error_frame(0x04, 0x08), ControllerState.ERROR_WARNING, ()),
        (error_frame(0x04, 0x20 | 0x08), ControllerState.ERROR_PASSIVE, ()),
        (error_frame(0x04, 0x01), None, ("controller receive overflow",)),
        (error_frame(0xA8), None, ("protocol violation", "no acknowledgement", "bus error")),
        (Frame(0x04, b"", error=True), None, ()),
    ],
)
def test_an_error_frame_is_read_by_linux_table(
    frame: Frame, state: ControllerState | None, kinds: tuple[str, ...]
) -> None:
    assert read_error_frame(frame) == ControllerReport(state, kinds)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_no_error_frame_is_too_strange(classes: int, data: bytes) -> None:
    report = read_error_frame(Frame(classes, data, error=True))
    assert (report.state is ControllerState.BUS_OFF) == bool(classes & 0x40)


def test_what_flaps_is_counted_each_time_and_told_now_and_then() -> None:
    health = BusHealth("can0")
    passive = ControllerReport(ControllerState.ERROR_PASSIVE, ("bus error",))
    for now_ns in (0, 1, TELL_AGAIN_NS - 1):
        health.reported(passive, now_ns)
    assert health.counts == {"error-passive": 3, "bus error": 3}
    assert health.has_link_events
    (sentence,) = health.take_link_events()
    assert not health.has_link_events
    assert sentence.startswith("can0 sees mostly errors (error-passive)")
    health.reported(passive, TELL_AGAIN_NS)
    assert health.take_link_events() == [sentence]


def test_an_outage_is_told_with_each_new_reason_and_its_length() -> None:
    health = BusHealth("can0")
    for now_ns, reason in ((10, "it is down"), (20, "it is down"), (30, "it is gone")):
        health.lost(now_ns, reason)
    assert [sentence.split(";")[0] for sentence in health.take_link_events()] == [
        "can0 is lost: it is down",
        "can0 is lost: it is gone",
    ]
    assert health.off_since_ns == 10
    health.back(1_500_000_010)
    health.back(1_500_000_011)
    assert health.take_link_events() == ["can0 is back after 1.5 s"]
    assert (health.off_since_ns, health.counts["lost"]) == (None, 1)


def test_frames_that_were_lost_here_are_counted() -> None:
    health = BusHealth("can0")
    health.overrun(0, 0)
    assert health.take_link_events() == []
    health.overrun(7, 0)
    health.overrun(3, 1)
    assert health.counts["frames not taken in time"] == 10
    assert len(health.take_link_events()) == 1


def attribute(kind: int, value: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(value), kind) + value + bytes(-len(value) % 4)


def link_message(info: bytes, *, flags: int = 1, hardware: int = 280) -> bytes:
    head = struct.pack("=BxHiII", 0, hardware, 3, flags, 0)
    return head + attribute(3, b"can0\0") + attribute(13, struct.pack("=I", 10)) + attribute(0x8000 | 18, info)


def test_a_controller_is_described_as_the_kernel_describes_it() -> None:
    data = attribute(1, struct.pack("=8I", 500_000, 875, *range(6))) + attribute(4, struct.pack("=I", 2))
    data += attribute(6, struct.pack("=I", 100)) + attribute(8, struct.pack("=HH", 128, 9))
    info = attribute(1, b"can\0") + attribute(2, data) + attribute(3, struct.pack("=6I", 0, 0, 0, 4, 0, 3))
    assert parse_link(link_message(info)) == CanInterface(
        name="can0",
        kind="can",
        is_can=True,
        is_up=True,
        queue_length=10,
        bitrate=500_000,
        state=ControllerState.ERROR_PASSIVE,
        restart_ms=100,
        transmit_errors=128,
        receive_errors=9,
        bus_offs=4,
    )


def test_what_a_driver_leaves_out_is_none() -> None:
    can = parse_link(link_message(attribute(1, b"can\0") + attribute(2, attribute(4, struct.pack("=I", 99)))))
    assert (can.state, can.bitrate, can.restart_ms, can.transmit_errors, can.bus_offs) == (None, None, 0, None, None)
    vcan = parse_link(link_message(attribute(1, b"vcan\0"), flags=0))
    assert (vcan.kind, vcan.is_up, vcan.restart_ms) == ("vcan", False, None)
    broken = parse_link(link_message(struct.pack("=HH", 2, 1)))  # an attribute that is shorter than itself
    assert broken.kind == ""


def test_this_kernel_is_asked() -> None:
    loopback = read_interface("lo")
    assert loopback is not None
    assert (loopback.name, loopback.is_can) == ("lo", False)
    assert read_interface("no_such_can") is None


@pytest.mark.parametrize("is_abstract", [False, True])
def test_systemd_is_told_of_the_first_heartbeat_and_then_four_times_in_a_watchdog_period(
    tmp_path: Path, is_abstract: bool
) -> None:
    place = f"@{tmp_path}/notify" if is_abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{place[1:]}" if is_abstract else place)
        systemd.setblocking(False)
        service = ServiceManager({"NOTIFY_SOCKET": place, "WATCHDOG_USEC": "4000"})
        for now_ns in range(0, 2_000_000, 250_000):
            service.lives(now_ns)
        service.status("can0 is lost")
        service.stopping()
        service.close()
        said = [systemd.recv(100).decode() for _ in range(5)]
        assert said == ["READY=1", "WATCHDOG=1", "WATCHDOG=1", "STATUS=can0 is lost", "STOPPING=1"]
        with pytest.raises(BlockingIOError):
            systemd.recv(100)


def test_without_systemd_or_with_one_that_is_gone_nothing_happens(tmp_path: Path) -> None:
    for environment in ({}, {"NOTIFY_SOCKET": str(tmp_path / "gone")}):
        service = ServiceManager(environment)
        service.lives(0)
        service.status("x")
        service.close()


def test_what_the_controller_counts_without_a_state_is_counted_and_not_told() -> None:
    health = BusHealth("can0")
    health.reported(ControllerReport(None, ("bus error",)), 0)
    assert health.counts == {"bus error": 1}
    assert health.take_link_events() == []
